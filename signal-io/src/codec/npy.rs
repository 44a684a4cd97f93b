//! NumPy arrays: a magic, a header that is a Python dictionary, and the bare numbers.
//!
//! Source: the `numpy.lib.format` specification, versions 1 to 3.

use std::io::Write;

use ::exr::prelude::f16;

use super::quantize::{interleave, to_f16, to_f32, to_u8, to_u16};
use crate::budget::{Budget, with_capacity};
use crate::error::Fault;
use crate::image::usual_names;
use crate::plan::Plan;
use crate::{Image, SampleType, Transfer};

const MAGIC: &[u8] = b"\x93NUMPY";

/// What the header says.
#[derive(Debug, PartialEq)]
pub(crate) struct Header {
    /// Byte order, kind and size, as in `<f4`.
    pub(crate) descr: String,
    pub(crate) fortran_order: bool,
    pub(crate) shape: Vec<u64>,
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Image, Fault> {
    let (header, body) = split_header(bytes)?;
    match header.shape[..] {
        [h, w] => decode_rows(&header, body, &[h], w, 1, budget),
        [h, w, c] => decode_rows(&header, body, &[h], w, c, budget),
        _ => {
            let what = format!("shape {:?} (a picture is (H, W) or (H, W, C))", header.shape);
            Err(Fault::Feature(what))
        }
    }
}

/// A light field with axes (V, U, Y, X) or (V, U, Y, X, C): its views one below the other, and
/// `[U, V]`. `None` for arrays that a picture can be.
pub(crate) fn decode_grid(
    bytes: &[u8],
    budget: &Budget,
) -> Result<Option<(Image, [usize; 2])>, Fault> {
    let (header, body) = split_header(bytes)?;
    let (rows, w, c) = match header.shape[..] {
        [_, _] | [_, _, _] => return Ok(None),
        [v, u, h, w] => ([v, u, h], w, 1),
        [v, u, h, w, c] => ([v, u, h], w, c),
        _ => {
            let what = format!(
                "shape {:?} (a light field is (V, U, Y, X) or (V, U, Y, X, C))",
                header.shape
            );
            return Err(Fault::Feature(what));
        }
    };
    let strip = decode_rows(&header, body, &rows, w, c, budget)?;
    Ok(Some((strip, [rows[1] as usize, rows[0] as usize])))
}

/// A picture whose rows are counted by several axes, the slowest first.
fn decode_rows(
    header: &Header,
    body: &[u8],
    axes: &[u64],
    width: u64,
    channels: u64,
    budget: &Budget,
) -> Result<Image, Fault> {
    let (size, sample, convert) = number_type(&header.descr)?;
    let height = axes.iter().fold(1, |product: u64, n| product.saturating_mul(*n));
    let count = budget.samples(width, height, channels)?;
    let expected = (count as u64).saturating_mul(size as u64);
    if body.len() as u64 != expected {
        let found = body.len();
        return Err(Fault::corrupt(format!("{expected} bytes of numbers expected, {found} found")));
    }
    let (w, h, c) = (width as usize, height as usize, channels as usize);
    // The number of a row when the first axis is the fastest one.
    let fortran_row = |y: usize| {
        let slowest_first = axes.iter().rev().fold((y, 0), |(rest, row), n| {
            let n = *n as usize;
            (rest / n, row * n + rest % n)
        });
        slowest_first.1
    };
    let mut data = with_capacity(count)?;
    for k in 0..c {
        for y in 0..h {
            let (start, step) = match header.fortran_order {
                true => (fortran_row(y) + h * w * k, h),
                false => (y * w * c + k, c),
            };
            let places = (0..w).map(|x| (start + x * step) * size);
            data.extend(places.map(|i| convert(&body[i..i + size])));
        }
    }
    let mut image = Image::new(w, h, &usual_names(c), data)?;
    (image.sample, image.transfer) = (sample, Transfer::Unspecified);
    Ok(image)
}

/// A conversion from the bytes of one number.
pub(crate) type Convert = fn(&[u8]) -> f32;

/// Bytes per number, the nearest sample type, and the conversion.
pub(crate) fn number_type(descr: &str) -> Result<(usize, SampleType, Convert), Fault> {
    use SampleType::{F16, F32, U8, U16};
    // `try_into` cannot fail: the caller passes as many bytes as the first field says.
    Ok(match descr {
        "|u1" | "<u1" | ">u1" => (1, U8, |b| f32::from(b[0]) / 255.0),
        "|b1" => (1, U8, |b| if b[0] == 0 { 0.0 } else { 1.0 }),
        "<u2" => (2, U16, |b| f32::from(u16::from_le_bytes([b[0], b[1]])) / 65_535.0),
        ">u2" => (2, U16, |b| f32::from(u16::from_be_bytes([b[0], b[1]])) / 65_535.0),
        "<f2" => (2, F16, |b| f16::from_le_bytes([b[0], b[1]]).to_f32()),
        ">f2" => (2, F16, |b| f16::from_be_bytes([b[0], b[1]]).to_f32()),
        "<f4" => (4, F32, |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        ">f4" => (4, F32, |b| f32::from_be_bytes([b[0], b[1], b[2], b[3]])),
        "<f8" => (8, F32, |b| f64::from_le_bytes(std::array::from_fn(|i| b[i])) as f32),
        ">f8" => (8, F32, |b| f64::from_be_bytes(std::array::from_fn(|i| b[i])) as f32),
        other => {
            let what = format!("numbers of type {other:?} (bool, u1, u2, f2, f4 and f8 are read)");
            return Err(Fault::Feature(what));
        }
    })
}

/// The header, and the numbers behind it.
pub(crate) fn split_header(bytes: &[u8]) -> Result<(Header, &[u8]), Fault> {
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| Fault::corrupt("the magic is missing"))?;
    let (length, rest) = match *rest {
        [1, _, a, b, ref rest @ ..] => (usize::from(u16::from_le_bytes([a, b])), rest),
        [2 | 3, _, a, b, c, d, ref rest @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, rest),
        [version, _, ..] if version > 3 => {
            return Err(Fault::Feature(format!("format version {version}")));
        }
        _ => return Err(Fault::cut_short()),
    };
    let (text, body) = rest.split_at_checked(length).ok_or_else(Fault::cut_short)?;
    let text = std::str::from_utf8(text).map_err(|_| Fault::corrupt("its header is not text"))?;
    Ok((parse_header(text)?, body))
}

/// Reads the three entries of the dictionary, in any order.
fn parse_header(text: &str) -> Result<Header, Fault> {
    let entry = |key: &str| {
        [format!("'{key}':"), format!("\"{key}\":")]
            .iter()
            .find_map(|quoted| text.split_once(quoted.as_str()))
            .map(|(_, value)| value.trim_start())
            .ok_or_else(|| Fault::corrupt(format!("its header has no entry {key:?}")))
    };
    let descr = entry("descr")?;
    let quote = descr.chars().next().filter(|c| matches!(c, '\'' | '"')).ok_or_else(|| {
        Fault::Feature("structured numbers (one type for the whole array is read)".to_owned())
    })?;
    let descr = descr[1..].split(quote).next().unwrap_or_default().to_owned();
    let order = entry("fortran_order")?;
    let fortran_order = match (order.starts_with("True"), order.starts_with("False")) {
        (true, _) => true,
        (_, true) => false,
        _ => return Err(Fault::corrupt("fortran_order is neither True nor False")),
    };
    let bad_shape = || Fault::corrupt("its shape is not a tuple of sizes");
    let shape = entry("shape")?.strip_prefix('(').and_then(|s| s.split_once(')'));
    let shape = shape.ok_or_else(bad_shape)?.0;
    let sizes = shape.split(',').map(str::trim).filter(|s| !s.is_empty());
    let shape = sizes.map(|s| s.trim_end_matches('L').parse().map_err(|_| bad_shape()));
    Ok(Header { descr, fortran_order, shape: shape.collect::<Result<_, _>>()? })
}

pub(super) fn encode(image: &Image, plan: &Plan, w: &mut impl Write) -> Result<usize, Fault> {
    encode_rows(image, &[image.height()], plan, w)
}

/// Writes a picture whose rows are counted by several axes, the slowest first.
pub(crate) fn encode_rows(
    image: &Image,
    axes: &[usize],
    plan: &Plan,
    w: &mut impl Write,
) -> Result<usize, Fault> {
    debug_assert_eq!(axes.iter().product::<usize>(), image.height());
    let (width, channels) = (image.width(), image.channels().len());
    let descr = match plan.sample {
        SampleType::U8 => "|u1",
        SampleType::U16 => "<u2",
        SampleType::F16 => "<f2",
        SampleType::F32 => "<f4",
    };
    let last = if channels == 1 { vec![width] } else { vec![width, channels] };
    write_header(descr, &[axes, &last].concat(), w)?;

    macro_rules! numbers {
        ($convert:ident) => {{
            let q = interleave(image, $convert);
            for v in &q.values {
                w.write_all(&v.to_le_bytes())?;
            }
            q.clipped
        }};
    }
    Ok(match plan.sample {
        SampleType::U8 => numbers!(to_u8),
        SampleType::U16 => numbers!(to_u16),
        SampleType::F16 => numbers!(to_f16),
        SampleType::F32 => numbers!(to_f32),
    })
}

/// Everything before the numbers of an array, the slowest axis first.
pub(crate) fn write_header(
    descr: &str,
    shape: &[usize],
    w: &mut impl Write,
) -> std::io::Result<()> {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let shape = format!("({})", shape.join(", "));
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    // The numbers shall start at a multiple of 64, after magic, version, length and a newline.
    let used = MAGIC.len() + 4 + header.len() + 1;
    header.extend(std::iter::repeat_n(' ', used.next_multiple_of(64) - used));
    header.push('\n');
    w.write_all(MAGIC)?;
    w.write_all(&[1, 0])?;
    w.write_all(&(header.len() as u16).to_le_bytes())?;
    w.write_all(header.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(version: u8, header: &str, body: &[u8]) -> Vec<u8> {
        let mut out = [MAGIC, &[version, 0]].concat();
        match version {
            1 => out.extend((header.len() as u16).to_le_bytes()),
            _ => out.extend((header.len() as u32).to_le_bytes()),
        }
        [out, header.as_bytes().to_vec(), body.to_vec()].concat()
    }

    fn read(bytes: &[u8]) -> Result<Image, Fault> {
        decode(bytes, &Budget::new(1 << 30))
    }

    #[test]
    fn versions_orders_and_byte_orders() {
        let c = "{'descr': '>u2', 'fortran_order': False, 'shape': (2, 3), }\n";
        let f = "{'shape': (2, 3), 'fortran_order': True, 'descr': \"<f8\"}";
        let numbers: Vec<u16> = (0..6).map(|v| v * 13_107).collect();
        let body: Vec<u8> = numbers.iter().flat_map(|v| v.to_be_bytes()).collect();
        // The same array column by column.
        let columns: Vec<u8> = [0, 3, 1, 4, 2, 5]
            .iter()
            .flat_map(|k| (f64::from(numbers[*k]) / 65_535.0).to_le_bytes())
            .collect();
        for version in 1..=3 {
            let by_rows = read(&file(version, c, &body)).unwrap();
            let by_columns = read(&file(version, f, &columns)).unwrap();
            assert_eq!((by_rows.width(), by_rows.height()), (3, 2));
            assert_eq!(by_rows.as_planar(), by_columns.as_planar());
            assert_eq!(by_rows.sample, SampleType::U16);
        }
        assert!(matches!(read(&file(4, c, &body)), Err(Fault::Feature(_))));
    }

    #[test]
    fn fortran_order_with_channels() {
        let header = "{'descr': '|u1', 'fortran_order': True, 'shape': (2, 3, 2)}";
        let body: Vec<u8> = (0..12).collect();
        let image = read(&file(1, header, &body)).unwrap();
        // Value (row 1, column 2, channel 1) is number 1 + 2 * (2 + 3 * 1) = 11 in Fortran order.
        assert_eq!(image.plane(1)[3 + 2], 11.0 / 255.0);
        assert_eq!(image.plane(0)[3], 1.0 / 255.0);
    }

    #[test]
    fn light_fields_in_both_orders() {
        // Axes (V, U, Y, X, C) of 2, 3, 2, 1, 2; numbers count in the order of the rows.
        let shape = [2, 3, 2, 1, 2];
        let body: Vec<u8> = (0..24).collect();
        let mut columns = Vec::new();
        for k in 0..24 {
            // The k-th number in Fortran order, whose first axis is the fastest.
            let mut rest = k;
            let index = shape.map(|n| {
                let i = rest % n;
                rest /= n;
                i
            });
            let c_order = index.iter().zip(shape).fold(0, |at, (i, n)| at * n + i);
            columns.push(c_order as u8);
        }
        let read = |order, body: &[u8]| {
            let text = "{'descr': '|u1', 'fortran_order': ORDER, 'shape': (2, 3, 2, 1, 2)}";
            let bytes = file(1, &text.replace("ORDER", order), body);
            decode_grid(&bytes, &Budget::new(1 << 20)).unwrap().unwrap()
        };
        let (by_rows, grid) = read("False", &body);
        assert_eq!((grid, by_rows.height()), ([3, 2], 12));
        assert_eq!(by_rows.plane(1)[5], 11.0 / 255.0);
        assert_eq!(read("True", &columns), (by_rows, grid));
    }

    #[test]
    fn lengths_must_match_exactly() {
        let header = "{'descr': '|b1', 'fortran_order': False, 'shape': (2, 2)}";
        assert_eq!(read(&file(1, header, &[0, 1, 7, 0])).unwrap().as_planar(), [0., 1., 1., 0.]);
        for n in [0, 3, 5] {
            assert!(matches!(read(&file(1, header, &vec![0; n])), Err(Fault::Corrupt(_))));
        }
    }

    #[test]
    fn headers_that_lie_are_typed_errors() {
        let with = |descr: &str, shape: &str| {
            let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}");
            read(&file(1, &header, &[0; 8]))
        };
        let huge = with("'<f4'", "(1000000000, 1000000000, 1000000000, )");
        assert!(matches!(huge, Err(Fault::TooLarge { .. })));
        assert!(matches!(with("'<f4'", "(0, 4)"), Err(Fault::Empty)));
        assert!(matches!(with("'<f4'", "(8,)"), Err(Fault::Feature(_))));
        assert!(matches!(with("'<f4'", "(-1, 4)"), Err(Fault::Corrupt(_))));
        assert!(matches!(with("'<f4'", "4"), Err(Fault::Corrupt(_))));
        assert!(matches!(with("'<c8'", "(1, 1)"), Err(Fault::Feature(_))));
        assert!(matches!(with("[('a', '<f4')]", "(1, 1)"), Err(Fault::Feature(_))));
        assert!(matches!(with("'|u1'", "(1, 1, 100000)"), Err(Fault::Feature(_))));
        assert!(matches!(with("'", "(1, 1)"), Err(Fault::Feature(_))));
    }
}
