use crate::{Domain, Error, Result};

/// The values of a signal with `C` channels on a lattice, one plane per channel.
///
/// Planes are stored one after the other; inside a plane axis 0 is contiguous.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples<const D: usize, const C: usize> {
    domain: Domain<D>,
    data: Vec<f32>,
}

impl<const D: usize, const C: usize> Samples<D, C> {
    /// All zero.
    pub fn zeros(domain: Domain<D>) -> Self {
        Self { domain, data: vec![0.0; domain.len() * C] }
    }

    /// Takes planar values: `C` planes of `domain.len()` each.
    ///
    /// # Errors
    /// [`Error::Length`] when the buffer does not match.
    pub fn from_planar(domain: Domain<D>, data: Vec<f32>) -> Result<Self> {
        let expected = domain.len() * C;
        if data.len() != expected {
            return Err(Error::Length { expected, found: data.len() });
        }
        Ok(Self { domain, data })
    }

    /// Takes interleaved values: the `C` channels of a sample side by side, as in most files.
    ///
    /// # Errors
    /// [`Error::Length`] when the buffer does not match.
    pub fn from_interleaved(domain: Domain<D>, data: &[f32]) -> Result<Self> {
        let (n, expected) = (domain.len(), domain.len() * C);
        if data.len() != expected {
            return Err(Error::Length { expected, found: data.len() });
        }
        let planar = (0..expected).map(|k| data[(k % n) * C + k / n]).collect();
        Ok(Self { domain, data: planar })
    }

    /// Samples a function at every lattice position.
    pub fn from_fn(domain: Domain<D>, mut f: impl FnMut([f32; D]) -> [f32; C]) -> Self {
        let n = domain.len();
        let mut out = Self::zeros(domain);
        for k in 0..n {
            for (c, v) in f(domain.position(domain.unflatten(k))).into_iter().enumerate() {
                out.data[c * n + k] = v;
            }
        }
        out
    }

    /// Where the samples sit.
    pub fn domain(&self) -> &Domain<D> {
        &self.domain
    }

    /// All planes, one after the other.
    pub fn as_planar(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after the other.
    pub fn as_planar_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The values of one channel.
    ///
    /// # Panics
    /// If `channel >= C`.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let n = self.domain.len();
        &self.data[channel * n..(channel + 1) * n]
    }

    /// The values of one channel.
    ///
    /// # Panics
    /// If `channel >= C`.
    pub fn plane_mut(&mut self, channel: usize) -> &mut [f32] {
        let n = self.domain.len();
        &mut self.data[channel * n..(channel + 1) * n]
    }

    /// The values with the channels of a sample side by side.
    pub fn to_interleaved(&self) -> Vec<f32> {
        let n = self.domain.len();
        (0..n * C).map(|k| self.data[(k % C) * n + k / C]).collect()
    }

    /// The first value that is NaN or infinite, as an error that says where it is.
    ///
    /// # Errors
    /// [`Error::NotFinite`].
    pub fn check_finite(&self) -> Result<()> {
        let n = self.domain.len();
        match self.data.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(k) => Err(Error::NotFinite {
                index: self.domain.unflatten(k % n).to_vec(),
                channel: k / n,
                value: self.data[k],
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interleaved_round_trip() {
        let domain = Domain::unit([3, 2]).unwrap();
        let data: Vec<f32> = (0..18).map(|v| v as f32).collect();
        let s = Samples::<2, 3>::from_interleaved(domain, &data).unwrap();
        assert_eq!(s.plane(1), [1.0, 4.0, 7.0, 10.0, 13.0, 16.0]);
        assert_eq!(s.to_interleaved(), data);
    }

    #[test]
    fn nan_is_located() {
        let domain = Domain::unit([3, 2]).unwrap();
        let mut s = Samples::<2, 2>::zeros(domain);
        s.plane_mut(1)[4] = f32::NAN;
        let error = s.check_finite().unwrap_err();
        assert!(
            matches!(error, Error::NotFinite { ref index, channel: 1, .. } if index == &[1, 1])
        );
    }
}
