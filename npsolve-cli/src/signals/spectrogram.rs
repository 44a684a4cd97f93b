//! Sound blended through its spectrogram: the log-magnitudes of the short-time Fourier transform are a picture of
//! frequency and time, and blend like one; the phase is that of both sounds together.

use anyhow::{Result, bail};
use inr_core::{Domain, RasterMask};
use signal_io::{Audio, Stft};

use super::audio::{Piece, Scene};
use super::{Job, Plain};
use crate::args::{SceneArgs, ValueDomain};
use crate::solve::{Settings, Solution};
use poisson_loss::{Objective, Options};

/// Length of a window in seconds: a few periods of the lowest voices.
const WINDOW: f64 = 0.046;
/// How far the background gives way, in hops of the window.
const HOPS: f32 = 1.5;
/// Magnitudes below this share of the largest, -60 dB, are noise to the logarithm. Otherwise how silent the silence of
/// both recordings is would decide how loud the patch becomes.
const FLOOR: f32 = 1e-3;

/// Blends the part of the background around the patch.
pub(super) fn blend(
    scene: &Scene,
    settings: &Settings,
    with_metrics: bool,
    quiet: bool,
) -> Result<Piece> {
    let rate = f64::from(scene.background.rate_hz());
    let window = ((WINDOW * rate) as usize).next_power_of_two().max(16);
    let stft = Stft::new(window)?;
    let hop = stft.hop();
    // Whole hops, so that the frames of both transforms lie at the same times.
    let (start, background) = scene.window(4.0 * window as f64)?;
    let n = background.frames();
    let aligned = shifted(&scene.inserted()?, scene.at - start as f64, n)?;
    let channels = background.channels();

    let transform =
        |audio: &Audio| -> Vec<_> { (0..channels).map(|c| stft.forward(audio.plane(c))).collect() };
    let spectra = [transform(&background), transform(&aligned)];
    let shape = [stft.bins(), stft.frames(n)];
    let domain = Domain::unit(shape)?;
    let largest = spectra.iter().flatten().flatten().map(|v| v.norm()).fold(0.0, f32::max);
    if largest == 0.0 {
        bail!(
            "{} and {} are silent there; nothing is to be blended",
            scene.names[0],
            scene.names[1]
        );
    }
    let floor = FLOOR * largest;
    let logarithms = |of: &[Vec<_>]| -> Vec<f32> {
        of.iter().flatten().map(|v: &signal_io::Complex32| (v.norm() + floor).ln()).collect()
    };
    let plain = |of: &[Vec<_>]| Plain { domain, values: logarithms(of) };

    // Frames that see nothing but the patch: its cut ends would be a crash in the spectrum.
    let first = scene.at - start as f64;
    let last = first + scene.part.len() as f64;
    let around = (window / 2 + hop) as f64;
    let within = |frame: usize| (first + around..last - around).contains(&((frame * hop) as f64));
    let weights: Vec<f32> =
        (0..domain.len()).map(|k| f32::from(u8::from(within(k / shape[0])))).collect();
    if weights.iter().all(|w| *w == 0.0) {
        bail!(
            "the part of {} is shorter than {:.0} ms, what the transform needs; take --mode waveform",
            scene.names[1],
            1e3 * (2.0 * around + hop as f64) / rate
        );
    }
    // Lengths were in samples of sound; here one sample is a window's hop in time.
    let options = Options {
        objective: match settings.options.objective {
            Objective::Screened { .. } => Objective::Screened { length: Some(HOPS), keep: None },
            other => other,
        },
        ..settings.options
    };
    let job = Job::new(
        &scene.names,
        plain(&spectra[0]),
        plain(&spectra[1]),
        RasterMask::new(domain, weights.clone())?,
        [0.0; 2],
        ValueDomain::Stored,
        &SceneArgs::default(),
    )?;
    let solution = job.solve(&Settings { options, ..*settings }, with_metrics, quiet)?;

    let mut planes = Vec::with_capacity(channels * n);
    for c in 0..channels {
        let (s, t) = (&spectra[0][c], &spectra[1][c]);
        let levels = &solution.planes[c * domain.len()..(c + 1) * domain.len()];
        let before = logarithms(std::slice::from_ref(s));
        let mixed: Vec<_> = (0..domain.len())
            .map(|k| {
                // Below a hundredth of a decibel nobody hears a change, and the sound keeps its bits.
                if (levels[k] - before[k]).abs() < 1e-3 {
                    return s[k];
                }
                let both = s[k] + t[k] * weights[k];
                let phase = if both.norm() > 0.0 { both / both.norm() } else { s[k] * 0.0 + 1.0 };
                phase * (levels[k].exp() - floor).max(0.0)
            })
            .collect();
        planes.extend(stft.inverse(&mixed, n));
    }
    untouched_ends(&mut planes, &background, &solution, hop, window);
    let mut solution = solution;
    solution.planes = planes;
    solution.report.box_start = vec![start];
    solution.report.box_shape = vec![n];
    let pasted = pasted(&background, &aligned, first, last);
    Ok(Piece { start, solution, pasted })
}

/// Frames that no changed frame of the transform reaches are the background's own, without its rounding.
fn untouched_ends(
    planes: &mut [f32],
    background: &Audio,
    solution: &Solution,
    hop: usize,
    window: usize,
) {
    let n = background.frames();
    let [start, shape] = [&solution.report.box_start, &solution.report.box_shape];
    let begin = (start[1] * hop).saturating_sub(window);
    let end = ((start[1] + shape[1]) * hop + window).min(n);
    for c in 0..background.channels() {
        let plane = background.plane(c);
        let own = &mut planes[c * n..(c + 1) * n];
        own[..begin.min(n)].copy_from_slice(&plane[..begin.min(n)]);
        own[end..].copy_from_slice(&plane[end..]);
    }
}

/// The patch at the nearest whole frame of `n`, mirrored at its ends for ever: silence around it would be a crash in
/// its spectrum.
fn shifted(patch: &Audio, at: f64, n: usize) -> Result<Audio> {
    let (whole, length) = (at.round() as i64, patch.frames() as i64);
    let mut planes = Vec::with_capacity(patch.channels() * n);
    for c in 0..patch.channels() {
        let plane = patch.plane(c);
        planes.extend((0..n as i64).map(|k| {
            let turn = (k - whole).rem_euclid(2 * length);
            plane[turn.min(2 * length - 1 - turn) as usize]
        }));
    }
    Ok(Audio::new(patch.rate_hz(), patch.channels(), planes)?)
}

fn pasted(background: &Audio, aligned: &Audio, first: f64, last: f64) -> Vec<f32> {
    let n = background.frames();
    let inside = |k: usize| (first.round()..last.round()).contains(&((k % n) as f64));
    let choose = |(k, (b, p)): (usize, (&f32, &f32))| if inside(k) { *p } else { *b };
    background.as_planar().iter().zip(aligned.as_planar()).enumerate().map(choose).collect()
}
