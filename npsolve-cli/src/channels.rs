//! From a number of channels known at run time to typed code: the only place that does it.

/// Most channels that are solved together.
pub const MOST: usize = 4;

/// The same for signals over `dimensions` coordinates: three beyond pictures, which keeps the program small.
pub const fn most(dimensions: usize) -> usize {
    if dimensions == 2 { MOST } else { 3 }
}

/// Work on samples with any number of channels.
pub trait ChannelJob {
    /// What comes out.
    type Output;
    /// Does it for `C` channels.
    fn run<const C: usize>(self) -> Self::Output;
}

/// Runs a job for this many channels; `None` for none or more than [`MOST`].
pub fn with_channels<J: ChannelJob>(channels: usize, job: J) -> Option<J::Output> {
    Some(match channels {
        1 => job.run::<1>(),
        2 => job.run::<2>(),
        3 => job.run::<3>(),
        4 => job.run::<4>(),
        _ => return None,
    })
}
