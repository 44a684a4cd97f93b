//! Numbers in names: `frame_9.png` comes before `frame_10.png`.

use std::cmp::Ordering;

/// Compares names as people count: runs of digits by their value, however long, all else by bytes.
/// Names that differ in leading zeros only are ordered by bytes, so the order is total.
pub(crate) fn compare(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(&p), Some(&q)) = (x.first(), y.first()) {
        let order = if p.is_ascii_digit() && q.is_ascii_digit() {
            let (m, n) = (take_digits(&mut x), take_digits(&mut y));
            m.len().cmp(&n.len()).then_with(|| m.cmp(n))
        } else {
            (x, y) = (&x[1..], &y[1..]);
            p.cmp(&q)
        };
        if order.is_ne() {
            return order;
        }
    }
    x.len().cmp(&y.len()).then_with(|| a.cmp(b))
}

/// Takes a run of digits off and answers it without its leading zeros.
fn take_digits<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(|b| !b.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    let zeros = digits.iter().position(|d| *d != b'0').unwrap_or(digits.len());
    &digits[zeros..]
}

/// The numbers in a name, from left to right; `None` for one that is too large for 64 bits.
pub(crate) fn numbers(name: &str) -> Vec<Option<u64>> {
    let runs = name.split(|c: char| !c.is_ascii_digit()).filter(|run| !run.is_empty());
    runs.map(|run| run.parse().ok()).collect()
}

/// The pieces of a name: runs of digits, and what is between them.
fn pieces(name: &str) -> Vec<&str> {
    name.split_inclusive(|c: char| !c.is_ascii_digit())
        .flat_map(|run| {
            let end = run.find(|c: char| !c.is_ascii_digit()).unwrap_or(run.len());
            [&run[..end], &run[end..]]
        })
        .filter(|piece| !piece.is_empty())
        .collect()
}

/// The first name that is missing from names in natural order which differ in one number only and
/// are meant to have equal steps; `None` where nothing is missing or names differ in other ways. The
/// step is the smallest that occurs: every fourth frame is a sequence, too.
pub(crate) fn missing(names: &[String]) -> Option<String> {
    let all: Vec<Vec<&str>> = names.iter().map(|name| pieces(name)).collect();
    let first = all.first()?;
    let mut place = None;
    for other in &all {
        if other.len() != first.len() {
            return None;
        }
        for k in (0..first.len()).filter(|k| other[*k] != first[*k]) {
            if *place.get_or_insert(k) != k {
                return None;
            }
        }
    }
    let place = place?;
    let number = |pieces: &Vec<&str>| pieces[place].parse::<u64>().ok();
    let numbers: Vec<u64> = all.iter().map(number).collect::<Option<_>>()?;
    let step = numbers.windows(2).map(|w| w[1].saturating_sub(w[0])).min()?.max(1);
    let gap = numbers.windows(2).position(|w| w[1].saturating_sub(w[0]) > step)?;
    let mut name = all[gap].clone();
    let number = format!("{:0width$}", numbers[gap] + step, width = name[place].len());
    name[place] = &number;
    Some(name.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_missing_name_is_found() {
        for (names, expected) in [
            (vec!["f_08.png", "f_09.png", "f_11.png"], Some("f_10.png")),
            (vec!["f9_v2.png", "f10_v2.png", "f12_v2.png"], Some("f11_v2.png")),
            (vec!["f0.png", "f4.png", "f8.png"], None),
            (vec!["f0.png", "f4.png", "f12.png"], Some("f8.png")),
            (vec!["1.png", "3.png"], None),
            (vec!["1.png"], None),
            (vec!["a.png", "b.png"], None),
            (vec!["a1b1", "a1b2", "a2b9"], None),
            (vec!["f1.jpg", "f1.png", "f5.png"], None),
            (vec!["f01.png", "f1.png", "f2.png"], None),
            (vec!["f1", "f99999999999999999999999"], None),
            (vec!["f18446744073709551613", "f18446744073709551614"], None),
            (vec![], None),
        ] {
            let names: Vec<String> = names.into_iter().map(str::to_owned).collect();
            assert_eq!(missing(&names).as_deref(), expected, "{names:?}");
        }
    }

    #[test]
    fn digits_count_as_numbers() {
        let sorted = [
            "1.png",
            "02.png",
            "10.png",
            "a",
            "a1b2",
            "a1b10",
            "a01b11",
            "a2",
            "a99999999999999999999999998",
            "a99999999999999999999999999",
            "b",
        ];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                assert_eq!(compare(a, b), i.cmp(&j), "{a} and {b}");
            }
        }
        assert_eq!(compare("a01", "a1"), Ordering::Less);
    }

    #[test]
    fn numbers_of_names() {
        assert_eq!(numbers("view_00_03"), [Some(0), Some(3)]);
        assert_eq!(numbers("r2c4"), [Some(2), Some(4)]);
        assert_eq!(numbers("x99999999999999999999"), [None]);
        assert!(numbers("none").is_empty());
    }
}
