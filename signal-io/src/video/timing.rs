/// How long the frames of a video are shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Timing {
    /// `frames / seconds` frames a second, all equally long; NTSC is 30000 / 1001. 0 in either place
    /// counts as unknown, which is 25 frames a second.
    Rate {
        /// Numerator.
        frames: u32,
        /// Denominator.
        seconds: u32,
    },
    /// Milliseconds that each frame is shown, as GIF and WebP store it. Frames beyond the list take
    /// its last entry.
    DelaysMs(Vec<u32>),
}

/// 25 frames a second, what is assumed of pictures in a folder.
impl Default for Timing {
    fn default() -> Self {
        Self::Rate { frames: 25, seconds: 1 }
    }
}

/// Animations that name no delay are shown with this one by the usual viewers.
const UNNAMED_DELAY_MS: u64 = 100;

impl Timing {
    /// The constant rate with the same mean; the shortest form of the fraction. Delays that are all
    /// 0, or none, give 10 frames a second, as viewers show them.
    pub fn to_rate(&self) -> Self {
        let (frames, seconds) = match self {
            Self::Rate { frames: 0, .. } | Self::Rate { seconds: 0, .. } => (25, 1),
            Self::Rate { frames, seconds } => (u64::from(*frames), u64::from(*seconds)),
            Self::DelaysMs(list) => {
                let sum: u64 = list.iter().map(|d| u64::from(*d)).sum();
                match sum {
                    0 => (1000, UNNAMED_DELAY_MS),
                    sum => (1000 * list.len() as u64, sum),
                }
            }
        };
        let divisor = gcd(frames, seconds);
        let (mut frames, mut seconds) = (frames / divisor, seconds / divisor);
        while frames.max(seconds) > u64::from(u32::MAX) {
            (frames, seconds) = (frames.div_ceil(2), seconds.div_ceil(2));
        }
        Self::Rate { frames: frames as u32, seconds: seconds as u32 }
    }

    /// How long each of `count` frames is shown, in units of `unit_ms` milliseconds, so that the
    /// errors of rounding do not add up: the end of every frame is rounded, not its length.
    pub(crate) fn delays(&self, count: usize, unit_ms: u32) -> Vec<u32> {
        let ends: Box<dyn Iterator<Item = u128>> = match (self, self.to_rate()) {
            (Self::DelaysMs(list), _) if !list.is_empty() => {
                let last = list[list.len() - 1];
                let all = list.iter().copied().chain(std::iter::repeat(last));
                Box::new(all.scan(0u128, |sum, delay| {
                    *sum += u128::from(delay);
                    Some(*sum)
                }))
            }
            (_, Self::Rate { frames, seconds }) => {
                let (n, d) = (u128::from(frames), 1000 * u128::from(seconds));
                Box::new((1..).map(move |t: u128| (2 * t * d + n) / (2 * n)))
            }
            (_, Self::DelaysMs(_)) => unreachable!("to_rate gives a rate"),
        };
        let unit = u128::from(unit_ms);
        let mut start = 0;
        let rounded = ends.take(count).map(|end| (2 * end + unit) / (2 * unit));
        rounded
            .map(|end| {
                let delay = end - start;
                start = end;
                u32::try_from(delay).unwrap_or(u32::MAX)
            })
            .collect()
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a.max(1) } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_do_not_drift() {
        let ntsc = Timing::Rate { frames: 30_000, seconds: 1001 };
        let delays = ntsc.delays(3000, 10);
        // 3000 frames at 29.97 a second are 100.1 seconds.
        assert_eq!(delays.iter().sum::<u32>(), 10_010);
        assert!(delays.iter().all(|d| matches!(d, 3 | 4)));
        assert_eq!(Timing::default().delays(2, 1), [40, 40]);
    }

    #[test]
    fn delays_stay_as_they_are() {
        let timing = Timing::DelaysMs(vec![10, 250, 0]);
        assert_eq!(timing.delays(4, 1), [10, 250, 0, 0]);
        assert_eq!(timing.delays(3, 10), [1, 25, 0]);
        assert_eq!(Timing::DelaysMs(vec![]).delays(1, 1), [100]);
    }

    #[test]
    fn mean_rates() {
        let rate = |frames, seconds| Timing::Rate { frames, seconds };
        assert_eq!(Timing::DelaysMs(vec![40, 40, 40]).to_rate(), rate(25, 1));
        assert_eq!(Timing::DelaysMs(vec![10, 30]).to_rate(), rate(50, 1));
        assert_eq!(Timing::DelaysMs(vec![0, 0]).to_rate(), rate(10, 1));
        assert_eq!(Timing::DelaysMs(vec![u32::MAX; 7]).to_rate(), rate(200, 858_993_459));
        assert_eq!(rate(0, 5).to_rate(), rate(25, 1));
        assert_eq!(rate(60_000, 2002).to_rate(), rate(30_000, 1001));
    }
}
