use std::time::{Duration, Instant};

use super::{Lattice, Trainer};
use crate::{Field, Jet, Order, Result, Samples};

/// When a fit ends: at the first of these that is reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// Steps in all, those before a resumption included. The schedule is laid over them.
    pub steps: u64,
    /// Time in all, that before a resumption included; the schedule is laid over it if it is the tighter limit, and
    /// then the result depends on the machine.
    pub budget: Option<Duration>,
    /// Peak signal-to-noise ratio in dB over all samples, measured when the batches promise it.
    pub target_psnr: Option<f64>,
    /// The signal's largest value less its smallest: the peak of the PSNR.
    pub peak: f32,
}

/// Where a fit stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitProgress {
    /// Steps taken.
    pub step: u64,
    /// How far along: 0..1.
    pub progress: f64,
    /// Seconds since the call.
    pub seconds: f64,
    /// PSNR in dB as the last batches show it.
    pub psnr: f64,
}

/// How a fit ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitReport {
    /// Steps taken in all.
    pub steps: u64,
    /// Seconds in this call.
    pub seconds: f64,
    /// PSNR in dB over all samples.
    pub psnr: f64,
    /// Whether the target was reached; true where none was set.
    pub reached: bool,
}

/// Losses, relative to the peak's square, that are all as good as the lowest: with the trainer's factor of a hundred
/// nothing above 20 dB is a divergence. Flat signals begin with almost no error, and any step is a rise from there.
const NEGLIGIBLE: f64 = 1e-4;

/// Trains the network on the values of a gridded signal, by least squares.
///
/// `report` is called after each step; if it returns false, the fit stops there and can be resumed from the trainer.
///
/// # Errors
/// [`Error::Diverged`](crate::Error::Diverged); the trainer holds the last good state.
pub fn fit<const D: usize, const C: usize>(
    trainer: &mut Trainer<D, C>,
    samples: &Samples<D, C>,
    options: &FitOptions,
    mut report: impl FnMut(&Trainer<D, C>, FitProgress) -> bool,
) -> Result<FitReport> {
    let (domain, begin) = (*samples.domain(), Instant::now());
    let lattice = Lattice::new(domain.shape(), trainer.options.batch);
    let (mut indices, mut x) = (Vec::new(), Vec::new());
    let (before, peak) = (trainer.watch.seconds, options.peak);
    let mut measured = None;
    trainer.negligible = NEGLIGIBLE;
    while trainer.steps() < options.steps {
        let spent = before + begin.elapsed().as_secs_f64();
        let of_time = options.budget.map_or(0.0, |b| spent / b.as_secs_f64().max(1e-9));
        if of_time >= 1.0 {
            break;
        }
        let progress = (trainer.steps() as f64 / options.steps as f64).max(of_time);
        lattice.batch(trainer.options.seed, trainer.steps(), &mut indices);
        x.clear();
        x.extend(indices.iter().map(|k| domain.position(domain.unflatten(*k))));
        let scale = 1.0 / (indices.len() * C) as f32;
        // Errors relative to the peak: neither bright nor faint signals leave the range of f32 when squared.
        let loss = |first: usize, y: &[Jet<D, C>], y_bar: &mut [Jet<D, C>]| {
            let mut sum = 0.0;
            for (k, (y, y_bar)) in indices[first..].iter().zip(y.iter().zip(y_bar)) {
                for c in 0..C {
                    let error = (y.value[c] - samples.plane(c)[*k]) / peak;
                    sum += error * error;
                    y_bar.value[c] = 2.0 * scale * error / peak;
                }
            }
            f64::from(sum * scale)
        };
        let squared = trainer.accumulate(&x, Order::Value, &loss);
        trainer.step(squared, progress)?;
        let step = trainer.steps();
        let mean = trainer.watch.recent.map_or(squared, |mean| mean + 0.2 * (squared - mean));
        let psnr_now = decibel(mean, 1.0);
        measured = None;
        let mut reached = false;
        if let Some(target) = options.target_psnr
            && psnr_now >= target
            && step >= trainer.watch.next_check
        {
            let psnr = psnr(&trainer.network, samples, peak);
            measured = Some(psnr);
            reached = psnr >= target;
            // Measuring takes as long as many steps; the next promise has to be a better one.
            trainer.watch.next_check = step + 20;
        }
        let seconds = begin.elapsed().as_secs_f64();
        trainer.watch.recent = Some(mean);
        trainer.watch.seconds = before + seconds;
        let go_on = report(trainer, FitProgress { step, progress, seconds, psnr: psnr_now });
        if reached || !go_on {
            break;
        }
    }
    let seconds = begin.elapsed().as_secs_f64();
    let psnr = measured.unwrap_or_else(|| psnr(&trainer.network, samples, options.peak));
    let reached = options.target_psnr.is_none_or(|target| psnr >= target);
    Ok(FitReport { steps: trainer.steps(), seconds, psnr, reached })
}

/// Peak signal-to-noise ratio in dB of a field against samples, over all samples and channels; infinite where they
/// agree.
pub fn psnr<const D: usize, const C: usize>(
    field: &impl Field<D, C>,
    samples: &Samples<D, C>,
    peak: f32,
) -> f64 {
    /// Samples at a time, so that big signals need no copy of themselves.
    const BATCH: usize = 1 << 16;
    let domain = samples.domain();
    let (mut x, mut y) = (Vec::new(), vec![[0.0; C]; BATCH]);
    let mut squared = 0.0;
    for first in (0..domain.len()).step_by(BATCH) {
        let batch = first..(first + BATCH).min(domain.len());
        x.clear();
        x.extend(batch.clone().map(|k| domain.position(domain.unflatten(k))));
        let y = &mut y[..x.len()];
        field.eval(&x, y);
        for c in 0..C {
            let plane = &samples.plane(c)[batch.clone()];
            squared +=
                plane.iter().zip(y.iter()).map(|(s, y)| f64::from(y[c] - s).powi(2)).sum::<f64>();
        }
    }
    decibel(squared / (domain.len() * C) as f64, peak)
}

fn decibel(squared: f64, peak: f32) -> f64 {
    10.0 * (f64::from(peak).powi(2) / squared).log10()
}
