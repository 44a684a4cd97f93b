//! Patterns of file names: `frame_%04d.png`, `frame_*.png`.

use std::path::{Path, PathBuf};

#[derive(Debug, Clone, PartialEq)]
enum Piece {
    Literal(char),
    /// `%d`, `%4d` or `%04d`: at least that many digits.
    Number {
        digits: usize,
    },
    /// `?`
    One,
    /// `*`
    Any,
}

/// A file name with places for numbers or for anything.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pattern {
    pieces: Vec<Piece>,
}

impl Pattern {
    /// The pattern a name is, unless it is an ordinary name. `%%` is a percent sign.
    pub(crate) fn parse(name: &str) -> Option<Self> {
        let mut pieces = Vec::new();
        let mut rest = name;
        while let Some(c) = rest.chars().next() {
            rest = &rest[c.len_utf8()..];
            pieces.push(match c {
                '*' => Piece::Any,
                '?' => Piece::One,
                '%' => match number(rest) {
                    Some((digits, after)) => {
                        rest = after;
                        Piece::Number { digits }
                    }
                    None => {
                        rest = rest.strip_prefix('%').unwrap_or(rest);
                        Piece::Literal('%')
                    }
                },
                c => Piece::Literal(c),
            });
        }
        let special = pieces.iter().any(|p| !matches!(p, Piece::Literal(_)));
        special.then_some(Self { pieces })
    }

    /// The folder and the pattern of a path whose last part is a pattern.
    pub(crate) fn of_path(path: &Path) -> Option<(PathBuf, Self)> {
        let pattern = Self::parse(path.file_name()?.to_str()?)?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
        Some((folder.unwrap_or(Path::new(".")).to_path_buf(), pattern))
    }

    /// Whether a name fits. Linear in the lengths of both, whatever the pattern.
    pub(crate) fn matches(&self, name: &str) -> bool {
        let chars: Vec<char> = name.chars().collect();
        // `reached[k]`: the pieces so far can stand for the first k characters.
        let mut reached = vec![false; chars.len() + 1];
        reached[0] = true;
        for piece in &self.pieces {
            let mut next = vec![false; chars.len() + 1];
            let mut run = 0; // Characters since the last start that a longer piece can go on from.
            let mut open = false;
            for k in 0..=chars.len() {
                let before = k.checked_sub(1).map(|b| (reached[b], chars[b]));
                match (piece, before) {
                    (Piece::Any, _) => {
                        open |= reached[k];
                        next[k] = open;
                    }
                    (Piece::Literal(c), Some((true, found))) => next[k] = *c == found,
                    (Piece::One, Some((true, _))) => next[k] = true,
                    (Piece::Number { digits }, Some((start, found))) => {
                        open |= start && run == 0;
                        run = if open && found.is_ascii_digit() { run + 1 } else { 0 };
                        open = run > 0;
                        next[k] = run >= *digits;
                    }
                    _ => {}
                }
            }
            reached = next;
        }
        reached[chars.len()]
    }

    /// Places for numbers.
    pub(crate) fn places(&self) -> usize {
        self.pieces.iter().filter(|p| matches!(p, Piece::Number { .. })).count()
    }

    /// The numbers in the places of a name that fits; `None` for one that is too large for 64 bits.
    /// Places take as many digits as they can, from left to right; `*` takes as little.
    pub(crate) fn numbers(&self, name: &str) -> Vec<Option<u64>> {
        let mut rest: Vec<char> = name.chars().collect();
        let mut numbers = Vec::new();
        for (k, piece) in self.pieces.iter().enumerate() {
            let after = Self { pieces: self.pieces[k + 1..].to_vec() };
            let fits = |n: &usize| after.matches(&rest[*n..].iter().collect::<String>());
            let digits = rest.iter().take_while(|c| c.is_ascii_digit()).count();
            let taken = match piece {
                Piece::Literal(_) | Piece::One => 1,
                Piece::Any => (0..=rest.len()).find(fits).unwrap_or(0),
                Piece::Number { digits: least } => {
                    let taken = (*least..=digits).rev().find(fits).unwrap_or(digits);
                    let text: String = rest[..taken].iter().collect();
                    numbers.push(text.parse().ok());
                    taken
                }
            };
            rest.drain(..taken.min(rest.len()));
        }
        numbers
    }

    /// How many numbers a name of this pattern takes; `None` where `*` or `?` make names unknown.
    pub(crate) fn number_count(&self) -> Option<usize> {
        let wild = self.pieces.iter().any(|p| matches!(p, Piece::Any | Piece::One));
        (!wild).then_some(self.places())
    }

    /// The name with these numbers.
    ///
    /// # Panics
    /// If there are fewer than [`Pattern::number_count`].
    pub(crate) fn name(&self, numbers: &[usize]) -> String {
        let mut numbers = numbers.iter();
        let mut name = String::new();
        for piece in &self.pieces {
            match piece {
                Piece::Literal(c) => name.push(*c),
                Piece::Number { digits } => {
                    let n = numbers.next().expect("one number per place");
                    name.push_str(&format!("{n:0width$}", width = *digits));
                }
                Piece::One | Piece::Any => unreachable!("number_count was asked"),
            }
        }
        name
    }
}

/// Whether the last part of a path has places for numbers or for anything.
pub(crate) fn is_pattern(path: &Path) -> bool {
    Pattern::of_path(path).is_some()
}

/// What follows `%` in a place for a number, and the rest.
fn number(text: &str) -> Option<(usize, &str)> {
    let (width, rest) = text.split_once('d')?;
    let digits = if width.is_empty() { 1 } else { width.parse::<usize>().ok()? };
    // 20 digits: more than any frame number has.
    (width.bytes().all(|b| b.is_ascii_digit()) && digits <= 20).then_some((digits.max(1), rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_names() {
        for (pattern, yes, no) in [
            (
                "frame_%04d.png",
                vec!["frame_0001.png", "frame_12345.png"],
                vec!["frame_001.png", "frame_0001.jpg", "frame_00a1.png"],
            ),
            ("f%d.png", vec!["f1.png", "f007.png"], vec!["f.png", "f1x.png", "xf1.png"]),
            ("*.png", vec![".png", "a.png", "a.png.png"], vec!["a.pngx", "png"]),
            ("a?c*", vec!["abc", "aécd"], vec!["ac", "bbc"]),
            ("%d%d", vec!["12", "123"], vec!["1", "1a"]),
            ("100%%_%d", vec!["100%_3"], vec!["100_3"]),
            ("*a*a*a*a*a*a*b", vec!["aaaaaaaaab"], vec!["aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"]),
        ] {
            let p = Pattern::parse(pattern).unwrap();
            yes.iter().for_each(|n| assert!(p.matches(n), "{pattern} and {n}"));
            no.iter().for_each(|n| assert!(!p.matches(n), "{pattern} and {n}"));
        }
        for name in ["frame.png", "100%.png", "%x", "", "50%%"] {
            assert_eq!(Pattern::parse(name), None, "{name}");
        }
    }

    #[test]
    fn numbers_of_names() {
        for (pattern, name, numbers) in [
            ("view_%02d_%d.png", "view_03_104.png", vec![Some(3), Some(104)]),
            ("%d%d", "1234", vec![Some(123), Some(4)]),
            ("*_%d_%d*", "a_1_b_22_33_4.png", vec![Some(22), Some(33)]),
            ("?%d*", "x7.png", vec![Some(7)]),
            ("%d", "99999999999999999999", vec![None]),
        ] {
            let p = Pattern::parse(pattern).unwrap();
            assert!(p.matches(name), "{pattern}");
            assert_eq!(p.numbers(name), numbers, "{pattern} and {name}");
        }
    }

    #[test]
    fn names_of_numbers() {
        let p = Pattern::parse("view_%02d_%d.png").unwrap();
        assert_eq!(p.number_count(), Some(2));
        assert_eq!(p.name(&[3, 104]), "view_03_104.png");
        assert!(p.matches(&p.name(&[100, 0])));
        assert_eq!(Pattern::parse("a*%d").unwrap().number_count(), None);
    }
}
