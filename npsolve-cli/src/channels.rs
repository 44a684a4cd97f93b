//! From a number of channels known at run time to typed code: the only place that does it.

/// Most channels that pictures have together.
pub const MOST: usize = 4;

/// Work on samples with any number of channels.
pub trait ChannelJob {
    /// What comes out.
    type Output;
    /// Does it for `C` channels.
    fn run<const C: usize>(self) -> Self::Output;
}

/// Signals over `D` coordinates.
pub struct Axes<const D: usize>;

/// The numbers of channels that there is code for. Every one of them makes the program larger and its building longer:
/// beyond pictures there are only the usual ones, and others are worked on in groups.
pub trait Channels {
    /// From small to large.
    const COUNTS: &'static [usize];

    /// Runs a job for one of these.
    fn run<J: ChannelJob>(count: usize, job: J) -> Option<J::Output>;
}

macro_rules! channels {
    ($dimensions:literal: $($count:literal)*) => {
        impl Channels for Axes<$dimensions> {
            const COUNTS: &'static [usize] = &[$($count),*];

            fn run<J: ChannelJob>(count: usize, job: J) -> Option<J::Output> {
                match count {
                    $($count => Some(job.run::<$count>()),)*
                    _ => None,
                }
            }
        }
    };
}

channels!(1: 1 2);
channels!(2: 1 2 3 4);
channels!(3: 1 3);
channels!(4: 1 3);

/// Runs a job for this many channels; `None` for numbers that there is no code for.
pub fn with_channels<const D: usize, J: ChannelJob>(count: usize, job: J) -> Option<J::Output>
where
    Axes<D>: Channels,
{
    <Axes<D> as Channels>::run(count, job)
}

/// Whether so many channels are worked on together.
pub fn is_one_group<const D: usize>(count: usize) -> bool
where
    Axes<D>: Channels,
{
    <Axes<D> as Channels>::COUNTS.contains(&count)
}

/// The numbers of channels worked on together, in words.
pub fn in_words<const D: usize>() -> String
where
    Axes<D>: Channels,
{
    let words: Vec<String> = <Axes<D> as Channels>::COUNTS.iter().map(usize::to_string).collect();
    words.join(", ")
}

/// Any number of channels as groups that there is code for: first channel and size of each.
pub fn groups<const D: usize>(count: usize) -> Vec<[usize; 2]>
where
    Axes<D>: Channels,
{
    let mut all = Vec::new();
    let mut first = 0;
    while first < count {
        let fits = |n: &&usize| **n <= count - first;
        let size = <Axes<D> as Channels>::COUNTS.iter().rev().find(fits).copied().unwrap_or(1);
        all.push([first, size]);
        first += size;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_as_large_as_there_is_code_for() {
        assert_eq!(groups::<2>(7), [[0, 4], [4, 3]]);
        assert_eq!(groups::<3>(5), [[0, 3], [3, 1], [4, 1]]);
        assert_eq!(groups::<1>(0), [[0usize; 2]; 0]);
        assert!(is_one_group::<4>(3) && !is_one_group::<4>(2) && in_words::<1>() == "1, 2");
    }
}
