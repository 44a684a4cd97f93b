//! Places and regions from the command line, in samples of a lattice.

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask};

use crate::values::{Coordinate, Counts, MeshFile, Place, Shape};

/// How coordinates with units become samples of a lattice. The usual ones are samples.
pub trait Units<const D: usize> {
    /// A place with units, as sample indices that may be fractions.
    fn position(&self, place: &Place) -> Result<Vec<f64>> {
        samples_only(place)
    }

    /// Lengths with units, as numbers of samples per axis.
    fn lengths(&self, lengths: &Place) -> Result<Vec<f64>> {
        samples_only(lengths)
    }

    /// The weight of every sample in a closed mesh.
    fn inside_mesh(&self, mesh: &MeshFile) -> Result<Vec<f32>> {
        bail!(
            "{mesh} is a region of volumes; this kind of signal takes box:, ellipsoid: and --mask"
        )
    }
}

/// Coordinates that count samples.
pub struct InSamples;

impl<const D: usize> Units<D> for InSamples {}

fn samples_only(place: &Place) -> Result<Vec<f64>> {
    let sample = |c: &Coordinate| match c.counts {
        Counts::Usual | Counts::Samples => Ok(c.value),
        _ => bail!(
            "{c} has a unit that this kind of signal does not have; write the number of samples"
        ),
    };
    place.0.iter().map(sample).collect()
}

/// A place with a coordinate for every axis; axes left out at the end are 0.
pub fn position<const D: usize>(place: &Place, units: &impl Units<D>) -> Result<[f64; D]> {
    let given = units.position(place)?;
    check_count::<D>(place, given.len())?;
    Ok(std::array::from_fn(|d| given.get(d).copied().unwrap_or(0.0)))
}

fn check_count<const D: usize>(place: &Place, count: usize) -> Result<()> {
    match (D.min(2)..=D).contains(&count) {
        true => Ok(()),
        false => bail!("{place} has {count} coordinates; this kind of signal has {D}"),
    }
}

/// The samples of a lattice that lie in a box, an ellipsoid or a mesh.
///
/// # Errors
/// Where no sample lies in it.
pub fn mask<const D: usize>(
    shape: &Shape,
    domain: Domain<D>,
    units: &impl Units<D>,
) -> Result<RasterMask<D>> {
    let weights = match shape {
        Shape::Mesh(file) => units.inside_mesh(file)?,
        _ => weights(domain, inside(shape, units)?),
    };
    if weights.iter().all(|w| *w == 0.0) {
        bail!(
            "no sample of the patch lies in --region; its samples go from 0 to {:?}",
            domain.shape()
        );
    }
    Ok(RasterMask::new(domain, weights)?)
}

/// Which samples lie in a box or an ellipsoid.
///
/// # Errors
/// For meshes, which have no answer sample by sample, and for coordinates that do not fit.
pub fn inside<const D: usize>(
    shape: &Shape,
    units: &impl Units<D>,
) -> Result<Box<dyn Fn([usize; D]) -> bool + Send + Sync>> {
    Ok(match shape {
        Shape::Box(min, max) => {
            let (a, b) = (units.position(min)?, units.position(max)?);
            check_count::<D>(min, a.len())?;
            let ends: Vec<[f64; 2]> =
                a.iter().zip(&b).map(|(a, b)| [a.min(*b), a.max(*b)]).collect();
            // Half open: the sample at the upper end is out; 1e-4 samples are rounding of units.
            Box::new(move |i| {
                ends.iter().zip(i).all(|([a, b], i)| (*a..*b).contains(&(i as f64 + 1e-4)))
            })
        }
        Shape::Ellipsoid(center, radii) => {
            let (center_at, radii_of) = (units.position(center)?, units.lengths(radii)?);
            check_count::<D>(center, center_at.len())?;
            Box::new(move |i| {
                let part = |(d, (c, r)): (usize, (&f64, &f64))| ((i[d] as f64 - c) / r).powi(2);
                center_at.iter().zip(&radii_of).enumerate().map(part).sum::<f64>() < 1.0
            })
        }
        Shape::Mesh(file) => bail!("{file} is a mesh; write box: or ellipsoid:, or take --mask"),
    })
}

fn weights<const D: usize>(domain: Domain<D>, inside: impl Fn([usize; D]) -> bool) -> Vec<f32> {
    (0..domain.len()).map(|k| f32::from(u8::from(inside(domain.unflatten(k))))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::values::{place, shape};

    #[test]
    fn shapes_select_samples() {
        let domain = Domain::unit([5, 4, 3]).unwrap();
        let count = |text: &str| {
            let mask = mask(&shape(text).unwrap(), domain, &InSamples)?;
            Ok::<_, anyhow::Error>(mask.weights().iter().sum::<f32>())
        };
        assert_eq!(count("box:1,1,1:4,3,2").unwrap(), 6.0);
        assert_eq!(count("box:0,0:5,1").unwrap(), 15.0);
        assert_eq!(count("ellipsoid:2,1,1:1.1,1.1,1.1").unwrap(), 7.0);
        assert_eq!(count("ellipsoid:2,1:0.5,0.5").unwrap(), 3.0);
        assert!(count("box:7,7,7:9,9,9").is_err() && count("box:0mm,0,0:1,1,1").is_err());
        assert!(count("box:0:1").is_err() && count("box:0,0,0,0:1,1,1,1").is_err());
        assert_eq!(position::<3>(&place("1,2").unwrap(), &InSamples).unwrap(), [1.0, 2.0, 0.0]);
    }
}
