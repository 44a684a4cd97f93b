//! NRRD with attached data: raw, gzip and ascii.
//!
//! Source: "Definition of NRRD file format" of the Teem library, versions 1 to 5.

use std::fmt::Write as _;
use std::io::Write;

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;

use super::affine::{self, Affine};
use super::nifti::{DEFLATE_RATIO, bad_place};
use super::numbers::{self, Axis, Coding, Order};
use super::{LengthUnit, Scaling, VoxelType};
use crate::Volume;
use crate::budget::{Budget, check_plausible, zeros};
use crate::error::Fault;

/// Longer than any header that has been seen; the search for its end stops here.
const MAX_HEADER: usize = 1 << 20;

/// The header's lines before they are understood.
struct Fields<'a> {
    list: Vec<(String, &'a str)>,
    /// Pairs of `key:=value`.
    entries: Vec<(String, String)>,
}

impl<'a> Fields<'a> {
    /// Splits the header off; returns the data, too.
    fn split(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), Fault> {
        let mut fields = Self { list: Vec::new(), entries: Vec::new() };
        let mut rest = bytes;
        for number in 0.. {
            if bytes.len() - rest.len() > MAX_HEADER {
                return Err(Fault::corrupt("its header has no end"));
            }
            let end = rest.iter().position(|b| *b == b'\n').ok_or_else(Fault::cut_short)?;
            let line = &rest[..end];
            rest = &rest[end + 1..];
            let line = std::str::from_utf8(line.strip_suffix(b"\r").unwrap_or(line))
                .map_err(|_| Fault::corrupt("its header is not text"))?;
            match line {
                _ if number == 0 => check_magic(line)?,
                "" => return Ok((fields, rest)),
                _ if line.starts_with('#') => {}
                _ => fields.push(line)?,
            }
        }
        unreachable!("the loop ends with the bytes")
    }

    fn push(&mut self, line: &'a str) -> Result<(), Fault> {
        if let Some((key, value)) = line.split_once(":=") {
            self.entries.push((key.to_owned(), value.to_owned()));
        } else if let Some((key, value)) = line.split_once(": ").or(line.split_once(':')) {
            let key: String = key.to_lowercase().chars().filter(|c| *c != ' ').collect();
            self.list.push((key, value.trim()));
        } else {
            let line: String = line.chars().take(60).collect();
            return Err(Fault::corrupt(format!("the line {line:?} of its header")));
        }
        Ok(())
    }

    /// The value of a field; names are lower case without blanks.
    fn get(&self, key: &str) -> Option<&'a str> {
        self.list.iter().find(|(k, _)| k == key).map(|(_, value)| *value)
    }

    fn need(&self, key: &str) -> Result<&'a str, Fault> {
        self.get(key).ok_or_else(|| Fault::corrupt(format!("its header has no field {key:?}")))
    }
}

fn check_magic(line: &str) -> Result<(), Fault> {
    match line {
        "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005" => Ok(()),
        _ if line.starts_with("NRRD") => Err(Fault::Feature(format!("version {line:?}"))),
        _ => Err(Fault::corrupt("the magic is missing")),
    }
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<Volume, Fault> {
    let (fields, body) = Fields::split(bytes)?;
    if fields.get("datafile").is_some() {
        return Err(Fault::Feature("its data in another file".to_owned()));
    }
    if ["lineskip", "byteskip"].iter().any(|k| fields.get(k).is_some_and(|n| n != "0")) {
        return Err(Fault::Feature("skipped lines or bytes".to_owned()));
    }
    let sizes = sizes(&fields)?;
    let channel = channel_axis(&fields, &sizes)?;
    let space: Vec<usize> = (0..sizes.len()).filter(|axis| Some(*axis) != channel).collect();
    let channels = channel.map_or(1, |axis| sizes[axis]);
    let [x, y, z] = [0, 1, 2].map(|d| sizes[space[d]]);
    let count = budget.samples(x.saturating_mul(y), z, channels)?;

    let shape = [x, y, z].map(|n| n as usize);
    let mut axes: Vec<Axis> = (0..3).map(Axis::Space).collect();
    if let Some(axis) = channel {
        axes.insert(axis, Axis::Channel);
    }
    let order = Order::new(shape, channels as usize, &axes);
    let sample = number_type(fields.need("type")?)?;
    let mut data = zeros_for(&fields, sample, count, body)?;
    read_data(&fields, sample, &order, body, &mut data)?;

    let (unit, affine) = geometry(&fields, &space)?;
    let volume = Volume::new(shape, channels as usize, data)?;
    let mut volume = volume.with_affine(affine).map_err(bad_place)?;
    (volume.voxel_type, volume.length_unit) = (sample, unit);
    volume.description = fields.get("content").unwrap_or_default().to_owned();
    volume.kept.oriented = fields.get("space").is_some_and(|s| world_signs(s).1);
    volume.kept.entries = fields.entries;
    Ok(volume)
}

fn sizes(fields: &Fields<'_>) -> Result<Vec<u64>, Fault> {
    let dimension = fields.need("dimension")?;
    let sizes = fields.need("sizes")?.split_whitespace().map(str::parse);
    let sizes: Vec<u64> =
        sizes.collect::<Result<_, _>>().map_err(|_| Fault::corrupt("its sizes are no sizes"))?;
    if dimension.parse() != Ok(sizes.len()) {
        return Err(Fault::corrupt(format!("{} sizes for {dimension:?} axes", sizes.len())));
    }
    match sizes.len() {
        3 | 4 => Ok(sizes),
        n => Err(Fault::Feature(format!("{n} axes (a volume has 3, or 4 with channels)"))),
    }
}

/// The axis that is not space: the one without a direction, of a kind that is a list, or without a
/// spacing; the last of four where nothing tells.
fn channel_axis(fields: &Fields<'_>, sizes: &[u64]) -> Result<Option<usize>, Fault> {
    let by = |key: &str, is_channel: &dyn Fn(&str) -> bool| {
        let words = fields.get(key).map(vectors).unwrap_or_default();
        let found: Vec<usize> = (0..words.len()).filter(|k| is_channel(words[*k])).collect();
        (found.len() == 1 && words.len() == sizes.len()).then(|| found[0])
    };
    let found = by("spacedirections", &|w| w == "none")
        .or_else(|| by("kinds", &|w| !matches!(w, "domain" | "space" | "???" | "none")))
        .or_else(|| by("spacings", &|w| w.eq_ignore_ascii_case("nan")));
    match (sizes.len(), found) {
        (3, Some(axis)) => {
            Err(Fault::Feature(format!("channels on axis {axis} of 3 (a volume has 3 more)")))
        }
        (3, None) => Ok(None),
        (_, found) => Ok(Some(found.unwrap_or(3))),
    }
}

/// Words, where blanks inside of parentheses do not count.
fn vectors(text: &str) -> Vec<&str> {
    let mut depth = 0;
    let words = text.split(|c: char| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        depth <= 0 && c.is_whitespace()
    });
    words.filter(|w| !w.is_empty()).collect()
}

fn number_type(name: &str) -> Result<VoxelType, Fault> {
    Ok(match name.to_lowercase().as_str() {
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => VoxelType::U8,
        "signed char" | "int8" | "int8_t" => VoxelType::I8,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            VoxelType::U16
        }
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            VoxelType::I16
        }
        "uint" | "unsigned int" | "uint32" | "uint32_t" => VoxelType::U32,
        "int" | "signed int" | "int32" | "int32_t" => VoxelType::I32,
        "float" => VoxelType::F32,
        "double" => VoxelType::F64,
        _ => return Err(Fault::Feature(format!("numbers of type {name:?}"))),
    })
}

/// Room for the values, if the bytes can hold so many.
fn zeros_for(
    fields: &Fields<'_>,
    sample: VoxelType,
    count: usize,
    body: &[u8],
) -> Result<Vec<f32>, Fault> {
    let promised = (count as u64).saturating_mul(sample.bytes() as u64);
    match encoding(fields)? {
        Encoding::Gzip => check_plausible(promised, body.len(), DEFLATE_RATIO)?,
        Encoding::Raw if promised > body.len() as u64 => return Err(Fault::cut_short()),
        // A digit and a blank for every number but the last.
        Encoding::Ascii if count > body.len() / 2 + 1 => return Err(Fault::cut_short()),
        Encoding::Raw | Encoding::Ascii => {}
    }
    zeros(count)
}

enum Encoding {
    Raw,
    Gzip,
    Ascii,
}

fn encoding(fields: &Fields<'_>) -> Result<Encoding, Fault> {
    Ok(match fields.need("encoding")?.to_lowercase().as_str() {
        "raw" => Encoding::Raw,
        "gz" | "gzip" => Encoding::Gzip,
        "txt" | "text" | "ascii" => Encoding::Ascii,
        other => return Err(Fault::Feature(format!("the encoding {other:?}"))),
    })
}

fn read_data(
    fields: &Fields<'_>,
    sample: VoxelType,
    order: &Order,
    mut body: &[u8],
    data: &mut [f32],
) -> Result<(), Fault> {
    let encoding = encoding(fields)?;
    let little = match (&encoding, fields.get("endian")) {
        (Encoding::Ascii, _) => true,
        (_, Some("little")) => true,
        (_, Some("big")) => false,
        _ if sample.bytes() == 1 => true,
        _ => return Err(Fault::corrupt("its header does not say the byte order")),
    };
    let coding = Coding { sample, little, scaling: Scaling::IDENTITY };
    match encoding {
        Encoding::Raw => numbers::read(&mut body, coding, order, data),
        Encoding::Gzip => numbers::read(&mut MultiGzDecoder::new(body), coding, order, data),
        Encoding::Ascii => numbers::read_text(body, order, data),
    }
}

/// Signs that turn a space's axes to right, anterior and superior, and whether the space is a body.
fn world_signs(space: &str) -> ([f64; 3], bool) {
    match space.to_lowercase().trim_end_matches("-time") {
        "right-anterior-superior" | "ras" => ([1.0, 1.0, 1.0], true),
        "left-anterior-superior" | "las" => ([-1.0, 1.0, 1.0], true),
        "left-posterior-superior" | "lps" => ([-1.0, -1.0, 1.0], true),
        _ => ([1.0, 1.0, 1.0], false),
    }
}

/// Three numbers as in `(1,0,0.5)`.
fn vector(text: &str) -> Result<[f64; 3], Fault> {
    let bad =
        || Fault::corrupt(format!("{:?} is no vector", text.chars().take(60).collect::<String>()));
    let inner = text.strip_prefix('(').and_then(|t| t.strip_suffix(')')).ok_or_else(bad)?;
    let numbers: Result<Vec<f64>, _> = inner.split(',').map(|n| n.trim().parse()).collect();
    numbers.ok().and_then(|n| n.try_into().ok()).ok_or_else(bad)
}

/// Directions and origin where the file has them, else spacings and the first position of each axis.
fn geometry(fields: &Fields<'_>, space: &[usize]) -> Result<(LengthUnit, Affine), Fault> {
    let units = fields.get("spaceunits").or(fields.get("units")).unwrap_or_default();
    let unit = units.split('"').find(|w| !w.trim().is_empty()).unwrap_or_default();
    let unit = LengthUnit::from_symbol(unit);
    let mut map = affine::diagonal([1.0; 3]);
    if let Some(text) = fields.get("spacedirections") {
        let columns: Vec<&str> = vectors(text).into_iter().filter(|w| *w != "none").collect();
        if columns.len() != 3 {
            return Err(Fault::corrupt(format!("{} directions for 3 axes", columns.len())));
        }
        let (signs, _) = world_signs(fields.get("space").unwrap_or_default());
        let origin = fields.get("spaceorigin").map_or(Ok([0.0; 3]), vector)?;
        let columns = [vector(columns[0])?, vector(columns[1])?, vector(columns[2])?, origin];
        map = std::array::from_fn(|r| std::array::from_fn(|c| signs[r] * columns[c][r]));
    } else if let Some(text) = fields.get("spacings") {
        let words: Vec<&str> = text.split_whitespace().collect();
        for (d, axis) in space.iter().enumerate() {
            let size = words.get(*axis).and_then(|w| w.parse::<f64>().ok()).ok_or_else(|| {
                Fault::corrupt(format!(
                    "the spacings {:?}",
                    text.chars().take(60).collect::<String>()
                ))
            })?;
            // The standard's word for unknown.
            map[d][d] = if size.is_nan() { 1.0 } else { size };
        }
    }
    Ok((unit, map.map(|row| row.map(|v| v * unit.millimetres()))))
}

pub(super) fn encode(volume: &Volume, coding: Coding, w: &mut impl Write) -> Result<usize, Fault> {
    w.write_all(header(volume, coding.sample).as_bytes())?;
    let order = Order::planar(volume.shape(), volume.channels());
    let mut gzip = GzEncoder::new(w, Compression::default());
    let clipped = numbers::write(volume.as_planar(), coding, &order, &mut gzip)?;
    gzip.finish()?;
    Ok(clipped)
}

fn header(volume: &Volume, sample: VoxelType) -> String {
    let ([x, y, z], channels) = (volume.shape(), volume.channels());
    let name = match sample {
        VoxelType::U8 => "uint8",
        VoxelType::I8 => "int8",
        VoxelType::U16 => "uint16",
        VoxelType::I16 => "int16",
        VoxelType::U32 => "uint32",
        VoxelType::I32 => "int32",
        VoxelType::F32 => "float",
        VoxelType::F64 => "double",
    };
    let mut out = format!("NRRD0004\ntype: {name}\n");
    match channels {
        1 => out.push_str("dimension: 3\n"),
        _ => out.push_str("dimension: 4\n"),
    }
    match volume.kept.oriented {
        true => out.push_str("space: right-anterior-superior\n"),
        false => out.push_str("space dimension: 3\n"),
    }
    let last = if channels == 1 { String::new() } else { format!(" {channels}") };
    let _ = writeln!(out, "sizes: {x} {y} {z}{last}");
    let scale = volume.length_unit.millimetres();
    let column = |c: usize| {
        let [a, b, c] = [0, 1, 2].map(|r| volume.affine[r][c] / scale);
        format!("({a},{b},{c})")
    };
    let none = if channels == 1 { "" } else { " none" };
    let _ = writeln!(out, "space directions: {} {} {}{none}", column(0), column(1), column(2));
    let list = if channels == 1 { "" } else { " list" };
    let _ = writeln!(out, "kinds: domain domain domain{list}\nendian: little\nencoding: gzip");
    let symbol = volume.length_unit.symbol();
    if !symbol.is_empty() {
        let _ = writeln!(out, "space units: \"{symbol}\" \"{symbol}\" \"{symbol}\"");
    }
    let _ = writeln!(out, "space origin: {}", column(3));
    let one_line = |text: &str| text.replace(['\n', '\r'], " ").trim().to_owned();
    if !volume.description.trim().is_empty() {
        let _ = writeln!(out, "content: {}", one_line(&volume.description));
    }
    for (key, value) in &volume.kept.entries {
        let _ = writeln!(out, "{key}:={value}");
    }
    out.push('\n');
    out
}
