use crate::error::Fault;

/// More channels than any picture has; a header that asks for more would only waste memory on names.
const MAX_CHANNELS: u64 = 4096;

/// Pictures of this decoded size are decoded without asking whether so few bytes can hold them:
/// allocating this much does no harm, and small pictures of one colour compress extremely well.
const HARMLESS_BYTES: u64 = 64 << 20;

/// How much memory a picture may take.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    limit: u64,
}

impl Budget {
    pub(crate) fn new(limit: u64) -> Self {
        Self { limit }
    }

    /// The limit for the decoded picture, in bytes.
    pub(crate) fn limit(&self) -> u64 {
        self.limit
    }

    /// The number of samples of a picture, if it has any and they may be allocated.
    pub(crate) fn samples(&self, width: u64, height: u64, channels: u64) -> Result<usize, Fault> {
        if width == 0 || height == 0 || channels == 0 {
            return Err(Fault::Empty);
        }
        let samples = width.saturating_mul(height).saturating_mul(channels);
        let needed = samples.saturating_mul(4);
        if needed > self.limit || needed > isize::MAX as u64 {
            return Err(Fault::TooLarge { needed, limit: self.limit });
        }
        if channels > MAX_CHANNELS {
            return Err(Fault::Feature(format!("{channels} channels")));
        }
        Ok(samples as usize)
    }

    /// The limit as the decoders of the `image` crate take it.
    pub(crate) fn to_image_limits(self) -> image::Limits {
        let mut limits = image::Limits::no_limits();
        // Metadata of a small picture may be larger than the picture.
        limits.max_alloc = Some(self.limit.max(HARMLESS_BYTES));
        limits
    }
}

/// Refuses a header that promises `promised` bytes where `present` bytes, expanded by the best
/// `ratio` of the compression, cannot hold them.
pub(crate) fn check_plausible(promised: u64, present: usize, ratio: u64) -> Result<(), Fault> {
    let possible = (present as u64).saturating_mul(ratio);
    if promised > HARMLESS_BYTES && promised > possible {
        return Err(Fault::corrupt(format!(
            "its header promises {promised} bytes of samples, its {present} bytes can hold {possible} at most"
        )));
    }
    Ok(())
}

/// Zeros, or an error where `vec![]` would end the program.
pub(crate) fn zeros<T: Clone + Default>(count: usize) -> Result<Vec<T>, Fault> {
    let mut out = with_capacity(count)?;
    out.resize(count, T::default());
    Ok(out)
}

/// An empty vector with room, or an error where `Vec::with_capacity` would end the program.
pub(crate) fn with_capacity<T>(count: usize) -> Result<Vec<T>, Fault> {
    let mut out = Vec::new();
    let needed = (count as u64).saturating_mul(size_of::<T>() as u64);
    out.try_reserve_exact(count).map_err(|_| Fault::OutOfMemory { needed })?;
    Ok(out)
}
