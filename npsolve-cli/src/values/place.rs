//! Coordinates, places and shapes of any number of axes.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// What a coordinate counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counts {
    /// What is usual for the kind of signal: seconds of sound, samples of everything else.
    Usual,
    /// Samples: pixels, voxels, frames.
    Samples,
    /// Seconds.
    Seconds,
    /// Millimetres.
    Millimetres,
}

/// A number with what it counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coordinate {
    /// The number.
    pub value: f64,
    /// What it counts.
    pub counts: Counts,
}

impl FromStr for Coordinate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // Longer suffixes first: "ms" ends like "s".
        let suffixes = [
            ("smp", Counts::Samples, 1.0),
            ("px", Counts::Samples, 1.0),
            ("mm", Counts::Millimetres, 1.0),
            ("ms", Counts::Seconds, 1e-3),
            ("s", Counts::Seconds, 1.0),
            ("", Counts::Usual, 1.0),
        ];
        let parsed = suffixes.iter().find_map(|(suffix, counts, factor)| {
            let value: f64 = text.trim().strip_suffix(suffix)?.trim().parse().ok()?;
            value.is_finite().then_some(Self { value: value * factor, counts: *counts })
        });
        parsed.ok_or_else(|| {
            format!("{text:?} is not a number, or one followed by smp, px, s, ms or mm")
        })
    }
}

impl fmt::Display for Coordinate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let suffix = match self.counts {
            Counts::Usual => "",
            Counts::Samples => "smp",
            Counts::Seconds => "s",
            Counts::Millimetres => "mm",
        };
        write!(f, "{}{suffix}", self.value)
    }
}

impl Coordinate {
    /// A number of samples.
    pub fn samples(value: f64) -> Self {
        Self { value, counts: Counts::Samples }
    }
}

/// One coordinate per axis, x first.
#[derive(Debug, Clone, PartialEq)]
pub struct Place(pub Vec<Coordinate>);

impl From<[f32; 2]> for Place {
    fn from(place: [f32; 2]) -> Self {
        Self(place.map(|v| Coordinate { value: f64::from(v), counts: Counts::Usual }).to_vec())
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<String> = self.0.iter().map(Coordinate::to_string).collect();
        f.write_str(&words.join(","))
    }
}

/// Parses `--at` and `--center`.
pub fn place(text: &str) -> Result<Place, String> {
    let coordinates: Result<Vec<Coordinate>, String> = text.split(',').map(str::parse).collect();
    match coordinates {
        Ok(all) if all.len() <= 4 => Ok(Place(all)),
        Ok(_) => Err("there are more than four coordinates".to_owned()),
        Err(what) => Err(format!("{what}; write numbers with commas and no space, as X,Y")),
    }
}

/// `--region`
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// `box:MIN:MAX`, without the samples at MAX.
    Box(Place, Place),
    /// `ellipsoid:CENTRE:RADII`
    Ellipsoid(Place, Place),
    /// `FILE.glb`, `FILE.gltf:m`
    Mesh(MeshFile),
}

/// A closed mesh in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshFile {
    /// A glTF file.
    pub path: PathBuf,
    /// What its numbers are.
    pub counts: MeshCounts,
}

/// What the coordinates of a mesh count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshCounts {
    /// Millimetres of the patch's world.
    Millimetres,
    /// Metres of the patch's world.
    Metres,
    /// Samples of the patch.
    Samples,
}

impl fmt::Display for MeshFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.path.display().fmt(f)
    }
}

/// The file of a mesh with its unit, if the name is one of a glTF file.
fn mesh_file(text: &str) -> Option<MeshFile> {
    let units = [
        (":mm", MeshCounts::Millimetres),
        (":m", MeshCounts::Metres),
        (":smp", MeshCounts::Samples),
    ];
    let given = units.into_iter().find_map(|(end, counts)| Some((text.strip_suffix(end)?, counts)));
    let (name, counts) = given.unwrap_or((text, MeshCounts::Millimetres));
    let path = PathBuf::from(name);
    let extension = path.extension()?.to_str()?.to_lowercase();
    ["glb", "gltf"].contains(&extension.as_str()).then_some(MeshFile { path, counts })
}

/// Parses `--region`.
pub fn shape(text: &str) -> Result<Shape, String> {
    const RULE: &str =
        "write box:X0,Y0,Z0:X1,Y1,Z1, ellipsoid:CX,CY,CZ:RX,RY,RZ or the name of a .glb file";
    let two = |rest: &str| {
        let (a, b) = rest.split_once(':').ok_or(RULE)?;
        let (a, b) = (place(a)?, place(b)?);
        match a.0.len() == b.0.len() {
            true => Ok((a, b)),
            false => Err("both halves of a region have as many coordinates".to_owned()),
        }
    };
    let positive = |place: &Place| place.0.iter().all(|c| c.value > 0.0);
    if let Some(rest) = text.strip_prefix("box:") {
        return two(rest).map(|(min, max)| Shape::Box(min, max));
    }
    if let Some(rest) = text.strip_prefix("ellipsoid:") {
        let (center, radii) = two(rest)?;
        return match positive(&radii) {
            true => Ok(Shape::Ellipsoid(center, radii)),
            false => Err("radii are above 0".to_owned()),
        };
    }
    mesh_file(text).map(Shape::Mesh).ok_or_else(|| RULE.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_say_what_they_count() {
        let of = |text: &str| text.parse::<Coordinate>().map(|c| (c.value, c.counts));
        assert_eq!(of("-3.5"), Ok((-3.5, Counts::Usual)));
        assert_eq!(of("44100smp"), Ok((44100.0, Counts::Samples)));
        assert_eq!(of("250ms"), Ok((0.25, Counts::Seconds)));
        assert_eq!(of("1.5s"), Ok((1.5, Counts::Seconds)));
        assert_eq!(of("12mm"), Ok((12.0, Counts::Millimetres)));
        for text in ["", "s", "nan", "inf", "1h", "1 2"] {
            assert!(of(text).is_err(), "{text}");
        }
        assert_eq!(place("-3.5,20").unwrap().to_string(), "-3.5,20");
        assert!(place("1,2,3,4,5").is_err() && place("3;4").is_err() && place("").is_err());
    }

    #[test]
    fn shapes_are_parsed_with_their_rules() {
        let box_of = shape("box:1,2,3:4,5,6").unwrap();
        assert_eq!(box_of, Shape::Box(place("1,2,3").unwrap(), place("4,5,6").unwrap()));
        assert!(matches!(shape("ellipsoid:1mm,2:3,4"), Ok(Shape::Ellipsoid(..))));
        for (text, counts) in [
            ("a:b/head.glb", MeshCounts::Millimetres),
            ("a:b/head.glb:m", MeshCounts::Metres),
            ("a:b/head.glb:mm", MeshCounts::Millimetres),
            ("a:b/head.glb:smp", MeshCounts::Samples),
        ] {
            let path = PathBuf::from("a:b/head.glb");
            assert_eq!(shape(text), Ok(Shape::Mesh(MeshFile { path, counts })), "{text}");
        }
        for text in ["box:1,2:3", "box:1,2", "ellipsoid:0,0:1,-1", "sphere:1:2", "mesh.obj", "box"]
        {
            assert!(shape(text).is_err(), "{text}");
        }
    }
}
