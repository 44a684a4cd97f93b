//! One table, written as text, CSV, LaTeX and JSON.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};

/// A column.
pub struct Column {
    /// Key in CSV and JSON.
    pub key: &'static str,
    /// Head in text and LaTeX.
    pub head: &'static str,
    /// How its numbers are shown.
    pub format: Format,
}

/// How numbers are shown in text and LaTeX; CSV and JSON have all digits.
#[derive(Debug, Clone, Copy)]
pub enum Format {
    /// Words.
    Text,
    /// So many digits after the point.
    Fixed(usize),
    /// Three significant digits and a power of ten.
    Power,
    /// Three significant digits, without a power of ten where the number is at least 1e-4.
    Significant,
    /// A share, shown in percent.
    Percent,
}

/// An entry.
pub enum Cell {
    /// Words.
    Text(String),
    /// A number; none or not finite where there is none.
    Number(Option<f64>),
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<f64> for Cell {
    fn from(value: f64) -> Self {
        Self::Number(Some(value).filter(|v| v.is_finite()))
    }
}

impl From<Option<f64>> for Cell {
    fn from(value: Option<f64>) -> Self {
        Self::Number(value.filter(|v| v.is_finite()))
    }
}

/// Rows of one kind, with what is needed to read them.
pub struct Table {
    /// What it is.
    pub title: String,
    /// Operator, rule, settings.
    pub notes: Vec<String>,
    /// The columns.
    pub columns: Vec<Column>,
    /// One entry per column each.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Aligned columns under the notes.
    pub fn to_text(&self) -> String {
        let mut text = format!("{}\n", self.title);
        self.notes.iter().for_each(|note| text += &format!("{note}\n"));
        text.push('\n');
        let shown: Vec<Vec<String>> = self
            .rows
            .iter()
            .map(|row| row.iter().zip(&self.columns).map(|(e, c)| shown(e, c.format)).collect())
            .collect();
        let width = |k: usize| {
            let head = self.columns[k].head.chars().count();
            shown.iter().map(|row| row[k].chars().count()).fold(head, usize::max)
        };
        let line = |entries: &[&str]| -> String {
            let mut line = String::new();
            for (k, entry) in entries.iter().enumerate() {
                let w = width(k);
                let _ = match self.columns[k].format {
                    Format::Text => write!(line, "{entry:<w$}  "),
                    _ => write!(line, "{entry:>w$}  "),
                };
            }
            line.trim_end().to_owned() + "\n"
        };
        text += &line(&self.columns.iter().map(|c| c.head).collect::<Vec<_>>());
        for row in &shown {
            text += &line(&row.iter().map(String::as_str).collect::<Vec<_>>());
        }
        text
    }

    /// A header and one line per row; numbers that do not exist are empty.
    pub fn to_csv(&self) -> String {
        let mut text = self.columns.iter().map(|c| c.key).collect::<Vec<_>>().join(",") + "\n";
        for row in &self.rows {
            let entries: Vec<String> = row
                .iter()
                .map(|entry| match entry {
                    Cell::Text(t) if t.contains([',', '"']) => {
                        format!("\"{}\"", t.replace('"', "\"\""))
                    }
                    Cell::Text(t) => t.clone(),
                    Cell::Number(v) => v.map_or(String::new(), |v| v.to_string()),
                })
                .collect();
            text += &(entries.join(",") + "\n");
        }
        text
    }

    /// A `tabular` with the notes as comments.
    pub fn to_tex(&self) -> String {
        let mut text = format!("% {}\n", self.title);
        self.notes.iter().for_each(|note| text += &format!("% {note}\n"));
        let align: String = self
            .columns
            .iter()
            .map(|c| if matches!(c.format, Format::Text) { 'l' } else { 'r' })
            .collect();
        let _ = writeln!(text, "\\begin{{tabular}}{{{align}}}\n\\hline");
        let heads: Vec<String> = self.columns.iter().map(|c| escaped(c.head)).collect();
        let _ = writeln!(text, "{} \\\\\n\\hline", heads.join(" & "));
        for row in &self.rows {
            let entries: Vec<String> =
                row.iter().zip(&self.columns).map(|(e, c)| escaped(&shown(e, c.format))).collect();
            let _ = writeln!(text, "{} \\\\", entries.join(" & "));
        }
        text + "\\hline\n\\end{tabular}\n"
    }

    /// Title, notes and one object per row.
    pub fn to_json(&self) -> Value {
        let rows: Vec<Value> = self
            .rows
            .iter()
            .map(|row| {
                let entries = row.iter().zip(&self.columns).map(|(entry, column)| {
                    let value = match entry {
                        Cell::Text(t) => json!(t),
                        Cell::Number(v) => json!(v),
                    };
                    (column.key.to_owned(), value)
                });
                Value::Object(entries.collect::<Map<_, _>>())
            })
            .collect();
        json!({ "title": self.title, "notes": self.notes, "rows": rows })
    }
}

fn shown(entry: &Cell, format: Format) -> String {
    let value = match entry {
        Cell::Text(text) => return text.clone(),
        Cell::Number(None) => return "-".to_owned(),
        Cell::Number(Some(value)) => *value,
    };
    match format {
        Format::Text => value.to_string(),
        Format::Fixed(digits) => format!("{value:.digits$}"),
        Format::Power => format!("{value:.2e}"),
        Format::Significant if value != 0.0 && value.abs() < 1e-4 => format!("{value:.2e}"),
        Format::Significant => {
            let digits = (2.0 - value.abs().max(1e-4).log10().floor()).clamp(0.0, 6.0) as usize;
            format!("{value:.digits$}")
        }
        Format::Percent => match 100.0 * value {
            v if v.abs() < 1e-3 => "0 %".to_owned(),
            v if v.abs() < 10.0 => format!("{v:.2} %"),
            v => format!("{v:.0} %"),
        },
    }
}

fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        if "%&_#$".contains(c) {
            out.push('\\');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_table_in_four_forms() {
        let column = |key, head, format| Column { key, head, format };
        let table = Table {
            title: "t".to_owned(),
            notes: vec!["rule".to_owned()],
            columns: vec![
                column("name", "name", Format::Text),
                column("x", "x", Format::Fixed(2)),
                column("share", "share", Format::Percent),
            ],
            rows: vec![
                vec!["a, b".into(), 1.5.into(), 0.25.into()],
                vec!["c_d".into(), f64::INFINITY.into(), 0.001.into()],
            ],
        };
        assert_eq!(
            table.to_text(),
            "t\nrule\n\nname     x   share\na, b  1.50    25 %\nc_d      -  0.10 %\n"
        );
        assert_eq!(table.to_csv(), "name,x,share\n\"a, b\",1.5,0.25\nc_d,,0.001\n");
        assert!(table.to_tex().contains("c\\_d & - & 0.10 \\% \\\\\n"), "{}", table.to_tex());
        assert_eq!(table.to_json()["rows"][1]["x"], Value::Null);
    }
}
