use serde::{Deserialize, Serialize};

/// How the learning rate changes over a training: the factor on the rate at its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Schedule {
    /// The way down.
    pub shape: Shape,
    /// Factor at the end, 0..1; exponential schedules need it above 0.
    pub floor: f32,
    /// Steps over which the rate first grows linearly from zero.
    pub warm_up: u64,
}

/// The way from 1 to the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// Stays at 1.
    Constant,
    /// Half a period of a cosine. Source: Loshchilov and Hutter 2017, eq. 5.
    Cosine,
    /// The same ratio everywhere.
    Exponential,
}

impl Schedule {
    /// A cosine down to 2 %.
    pub const COSINE: Self = Self { shape: Shape::Cosine, floor: 0.02, warm_up: 0 };

    /// The factor at step number `step`, `progress` (0..1) of the way through the training.
    pub fn factor(&self, step: u64, progress: f64) -> f32 {
        let (floor, t) = (f64::from(self.floor), progress.clamp(0.0, 1.0));
        let down = match self.shape {
            Shape::Constant => 1.0,
            Shape::Cosine => floor + (1.0 - floor) * 0.5 * (1.0 + (std::f64::consts::PI * t).cos()),
            Shape::Exponential => floor.powf(t),
        };
        let up = ((step + 1) as f64 / self.warm_up.max(1) as f64).min(1.0);
        (down * up) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_begin_at_one_and_end_at_the_floor() {
        for shape in [Shape::Cosine, Shape::Exponential] {
            let schedule = Schedule { shape, floor: 0.1, warm_up: 0 };
            assert_eq!(schedule.factor(0, 0.0), 1.0);
            assert!((schedule.factor(9, 1.0) - 0.1).abs() < 1e-7);
            assert!(
                (1..=10).all(|k| schedule.factor(k, k as f64 / 10.0)
                    < schedule.factor(k, (k - 1) as f64 / 10.0))
            );
        }
        let middle = Schedule { shape: Shape::Cosine, floor: 0.0, warm_up: 0 }.factor(5, 0.5);
        assert!((middle - 0.5).abs() < 1e-7);
        let warm = Schedule { shape: Shape::Constant, floor: 1.0, warm_up: 4 };
        assert_eq!([0, 1, 3, 9].map(|k| warm.factor(k, 0.0)), [0.25, 0.5, 1.0, 1.0]);
    }
}
