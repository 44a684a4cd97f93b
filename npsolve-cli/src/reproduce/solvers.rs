//! The solvers of the figures, and one way to score them all.

use std::time::Instant;

use anyhow::{Result, anyhow};
use inr_core::{Architecture, Frame, Network, Output, Samples, Spline, TrainOptions, Trainer};
use poisson_loss::{
    Baseline, Blend, DiscreteMinimum, Metrics, NeuralOptions, Objective, Options, PaperLoss,
    PaperOptions, Problem, discrete_minimum, insert, measure, neural_box, paper_loss, solve,
    solve_baseline, train_blend, train_paper,
};

use super::Meter;
use super::setting::Setting;
use super::table::{Cell, Column, Format};

/// How everything is measured.
pub const OPERATORS: [&str; 3] = [
    "m1, m2: cubic splines through the results, midpoint rule with 2 points per knot interval and axis; \
     value^2, m1 per pixel^2; paper scale: 500 |Omega|/|S|/C m1, 1000 (1-|Omega|/|S|)/C m2",
    "L_grad, L_color: forward, backward and centred pixel differences, 500 and 1000 times the mean over the \
     whole picture, v made on the mask eroded by 1 px; loss = L_grad + weight L_color, 0.2 as released",
    "float, unclipped; excess: over the exact minimum of the screened objective (splines), and of the loss \
     (pixels); seam: |grad c - v| within 3 px of the edge, in grey levels of 255 per pixel",
];

/// Samples over which the network of [`grid`] fades into the background.
const FADE: usize = 8;

/// A problem with the exact minima that results are compared with.
pub struct Bench<'a> {
    /// The screened problem.
    pub problem: Problem<'a, 2, 3>,
    /// Its exact minimum, and the seconds that took.
    pub exact: (Blend<2, 3>, f64),
    /// The paper's loss.
    pub paper: PaperOptions,
    /// Its exact minimum, and the seconds that took.
    pub minimum: (DiscreteMinimum<2, 3>, f64),
}

/// A result with its scores.
pub struct Scored {
    /// The solver.
    pub label: String,
    /// Its time.
    pub seconds: f64,
    /// The result.
    pub samples: Samples<2, 3>,
    /// Scores in the spline operator.
    pub metrics: Metrics,
    /// The loss in the pixel operator, and its excess over the least possible.
    pub loss: PaperLoss,
    /// See `loss`.
    pub loss_excess: f64,
}

impl<'a> Bench<'a> {
    /// Solves both objectives exactly.
    pub fn new(problem: Problem<'a, 2, 3>, paper: PaperOptions) -> Result<Self> {
        let begin = Instant::now();
        let exact = solve(&problem)?;
        let exact = (exact, begin.elapsed().as_secs_f64());
        let begin = Instant::now();
        let minimum = discrete_minimum(&problem, problem.background.domain(), &paper)?;
        let minimum = (minimum, begin.elapsed().as_secs_f64());
        Ok(Self { problem, exact, paper, minimum })
    }

    /// Scores a result of any solver.
    pub fn score(&self, label: &str, samples: Samples<2, 3>, seconds: f64) -> Result<Scored> {
        let metrics = measure(&self.problem, &samples, Some(&self.exact.0.samples))?;
        let on = self.problem.background.domain();
        let loss = paper_loss(&self.problem, on, &self.paper, &samples)?;
        let least = self.minimum.0.loss.total;
        // The minimum itself was rounded to f32.
        let loss_excess = ((loss.total - least) / least).max(0.0);
        Ok(Scored { label: label.to_owned(), seconds, samples, metrics, loss, loss_excess })
    }

    /// The screened objective's exact minimum.
    pub fn ours(&self) -> Result<Scored> {
        self.score("ours, exact", self.exact.0.samples.clone(), self.exact.1)
    }

    /// The paper's discrete loss at its least.
    pub fn least(&self) -> Result<Scored> {
        self.score("paper, minimum of loss", self.minimum.0.samples.clone(), self.minimum.1)
    }

    /// Classical Poisson editing.
    pub fn pie(&self) -> Result<Scored> {
        let begin = Instant::now();
        let blend = solve_baseline(&self.problem, Baseline::Pie)?;
        self.score("PIE", blend.samples, begin.elapsed().as_secs_f64())
    }

    /// The paper's objective among splines.
    pub fn paper_spline(&self, lambda: f32) -> Result<Scored> {
        let options = Options { objective: Objective::Paper { lambda }, ..self.problem.options };
        let begin = Instant::now();
        let blend = solve(&Problem { options, ..self.problem.clone() })?;
        self.score("paper, exact spline", blend.samples, begin.elapsed().as_secs_f64())
    }

    /// The paper's solver.
    pub fn diner(&self, label: &str, meter: &mut Meter) -> Result<Scored> {
        let (on, options) = (self.problem.background.domain(), &self.paper);
        let unit = on.len() as f32;
        let blend = train_paper(&self.problem, on, options, |now| {
            meter.within(now.step as f32 * unit);
            true
        })?;
        meter.finish(options.steps as f32 * unit);
        self.score(label, blend.samples, blend.seconds + blend.fitting)
    }

    /// Ours as a network.
    pub fn grid(&self) -> Result<Scored> {
        let begin = Instant::now();
        let samples = grid(&self.problem, &self.exact.0)?;
        self.score("ours, grid network", samples, self.exact.1 + begin.elapsed().as_secs_f64())
    }
}

/// The blend as a network, on the box that changes: it begins at the exact solution, as `blend --field grid` does.
fn grid(problem: &Problem<'_, 2, 3>, exact: &Blend<2, 3>) -> Result<Samples<2, 3>> {
    let on = neural_box(problem, exact);
    let (architecture, output) =
        (Architecture::spline_grid(&on.shape(), 3), Output::of_range(0.0, 1.0));
    let mut network = Network::new(architecture, Frame::of_samples(&on), output, 1)?;
    network.load_spline(&Spline::interpolate(&exact.samples))?;
    let train = TrainOptions { rate: 1e-4, table_rate: 1e-5, ..TrainOptions::default() };
    let mut trainer = Trainer::new(network, train);
    let options = NeuralOptions { distill: 0.0, tolerance: Some(1e-3), ..NeuralOptions::default() };
    train_blend(problem, exact, &on, &mut trainer, &options, |_| true)?;
    Ok(insert(problem.background, &trainer.network, &on, FADE))
}

/// The lambda of the paper's objective that the released weights amount to.
pub fn released_lambda(setting: &Setting) -> Result<f32> {
    let (all, inside) = (setting.background.domain().len() as f64, setting.measure());
    if inside < 1.0 || inside >= all {
        return Err(anyhow!("the region of {} is empty or covers everything", setting.name));
    }
    Ok((0.4 * (all - inside) / inside) as f32)
}

/// Columns of [`Scored::cells`].
pub fn columns() -> Vec<Column> {
    [
        ("seconds", "seconds", Format::Fixed(2)),
        ("m1", "m1", Format::Power),
        ("m2", "m2", Format::Power),
        ("m1_paper", "m1 paper", Format::Significant),
        ("m2_paper", "m2 paper", Format::Significant),
        ("excess_screened", "excess", Format::Percent),
        ("l_grad", "L_grad", Format::Significant),
        ("l_color", "L_color", Format::Significant),
        ("loss", "loss", Format::Significant),
        ("excess_loss", "excess", Format::Percent),
        ("seam_rms_levels", "seam", Format::Fixed(2)),
        ("seam_max_levels", "max", Format::Fixed(1)),
        ("psnr_outside", "PSNR out", Format::Fixed(1)),
        ("outside_unit_range", "not 0..1", Format::Percent),
    ]
    .map(|(key, head, format)| Column { key, head, format })
    .into()
}

impl Scored {
    /// The numbers of a row.
    pub fn cells(&self) -> Vec<Cell> {
        let (m, loss) = (&self.metrics, &self.loss);
        vec![
            self.seconds.into(),
            m.m1.into(),
            m.m2.into(),
            m.m1_paper.into(),
            m.m2_paper.into(),
            m.excess_energy.into(),
            loss.gradient.into(),
            loss.color.into(),
            loss.total.into(),
            self.loss_excess.into(),
            (255.0 * m.seam_rms).into(),
            (255.0 * m.seam_max).into(),
            m.psnr_outside.into(),
            m.outside_unit_range.into(),
        ]
    }

    /// A line below a picture.
    pub fn caption(&self) -> String {
        let m = &self.metrics;
        format!("m1 {:.1e} m2 {:.1e} seam {:.2}", m.m1_paper, m.m2_paper, 255.0 * m.seam_rms)
    }
}
