//! Blends as networks: the loss they are trained with, where they begin, and where they end.

use inr_core::{
    Adam, Architecture, Domain, Frame, Interpolation, Network, Output, Samples, Spline,
    TrainOptions, Trainer,
};
use npsolve_tests::signals::{ball, textured};
use poisson_loss::{
    Blend, Error, Guidance, NeuralOptions, Objective, Options, Patch, Problem, insert, measure,
    neural_box, solve, train_blend,
};

const SHAPE: [usize; 2] = [46, 38];

struct Case {
    background: Samples<2, 2>,
    patch: Samples<2, 2>,
    region: inr_core::RasterMask<2>,
    objective: Objective,
    guidance: Guidance<2, 2>,
}

impl Case {
    fn new(objective: Objective, guidance: Guidance<2, 2>) -> Self {
        let domain = Domain::unit(SHAPE).unwrap();
        let (background, patch) = (textured(domain, 1), textured(domain, 2));
        Self { background, patch, region: ball(domain, 0.5), objective, guidance }
    }

    fn problem(&self) -> Problem<'_, 2, 2> {
        Problem {
            background: &self.background,
            patch: Patch::Samples { samples: &self.patch, offset: [0.0; 2] },
            region: &self.region,
            guidance: self.guidance.clone(),
            options: Options::with_objective(self.objective),
        }
    }
}

/// A training that evaluates and never moves.
fn still(network: Network<2, 2>) -> Trainer<2, 2> {
    let options =
        TrainOptions { rate: 0.0, table_rate: 0.0, batch: 1 << 20, ..TrainOptions::default() };
    Trainer::new(network, options)
}

fn spline_network(exact: &Blend<2, 2>, on: &Domain<2>) -> Network<2, 2> {
    let architecture = Architecture::spline_grid(&on.shape(), 2);
    let frame = Frame::of_samples(on);
    let mut network = Network::new(architecture, frame, Output::of_range(0.0, 1.0), 1).unwrap();
    network.load_spline(&Spline::interpolate(&exact.samples)).unwrap();
    network
}

/// Losses of the four sub-lattices, unmixed from the running means that are reported.
fn losses(
    problem: &Problem<'_, 2, 2>,
    exact: &Blend<2, 2>,
    network: Network<2, 2>,
    distill: f64,
) -> [f64; 4] {
    let on = *problem.background.domain();
    let (mut means, options) =
        (Vec::new(), NeuralOptions { steps: 4, distill, ..NeuralOptions::default() });
    train_blend(problem, exact, &on, &mut still(network), &options, |p| {
        means.push(p.loss);
        true
    })
    .unwrap();
    std::array::from_fn(|k| if k == 0 { means[0] } else { (means[k] - 0.9 * means[k - 1]) / 0.1 })
}

#[test]
fn the_loss_is_the_objective_of_the_metrics() {
    let keep = Objective::Screened { length: Some(3.0), keep: Some(5.0) };
    for (objective, guidance) in [
        (Objective::default(), Guidance::Patch),
        (keep, Guidance::SUM),
        (Objective::Paper { lambda: 3.0 }, Guidance::Strongest(Default::default())),
    ] {
        let case = Case::new(objective, guidance);
        let problem = case.problem();
        let exact = solve(&problem).unwrap();
        // Another field than the solution: the background's own spline.
        let on = *problem.background.domain();
        let mut network = spline_network(&exact, &on);
        network.load_spline(&inr_core::Spline::interpolate(&case.background)).unwrap();
        let sum: f64 = losses(&problem, &exact, network, 0.0).iter().sum();
        let got = sum * on.len() as f64 * 0.25 / exact.report.region_samples;
        let want = measure(&problem, &case.background, None).unwrap().objective;
        // f32 gradients of a few hundred points.
        assert!((got - want).abs() < 1e-4 * want, "{objective:?}: {got} instead of {want}");
    }
}

#[test]
fn a_spline_grid_begins_at_the_exact_solution() {
    let case = Case::new(Objective::default(), Guidance::Patch);
    let problem = case.problem();
    let exact = solve(&problem).unwrap();
    let on = *problem.background.domain();
    let at_exact = losses(&problem, &exact, spline_network(&exact, &on), 1.0);
    assert!(at_exact.iter().all(|l| *l < 1e-9), "{at_exact:?}");

    let mut trainer = still(spline_network(&exact, &on));
    let options = NeuralOptions { tolerance: Some(1e-3), ..NeuralOptions::default() };
    let report = train_blend(&problem, &exact, &on, &mut trainer, &options, |_| true).unwrap();
    assert_eq!(report.last.step, 0);
    let samples = insert(&case.background, &trainer.network, &on, 0);
    let metrics = measure(&problem, &samples, Some(&exact.samples)).unwrap();
    assert!(
        metrics.excess_energy.unwrap() < 1e-4 && metrics.rmse_inside.unwrap() < 1e-5,
        "{metrics:?}"
    );
}

#[test]
fn compact_networks_come_near_and_stay_near() {
    let case = Case::new(Objective::default(), Guidance::Patch);
    let problem = case.problem();
    let exact = solve(&problem).unwrap();
    let on = neural_box(&problem, &exact);
    let network = Network::new(
        Architecture::grid(&on.shape(), 1 << 12),
        Frame::of_cells(&on),
        Output::of_range(0.0, 1.0),
        1,
    )
    .unwrap();
    let mut trainer =
        Trainer::new(network, TrainOptions { batch: 1024, ..TrainOptions::default() });
    let options = NeuralOptions { steps: 600, ..NeuralOptions::default() };
    let mut first = None;
    let report = train_blend(&problem, &exact, &on, &mut trainer, &options, |p| {
        first.get_or_insert(p.distance);
        true
    })
    .unwrap();
    // Two orders of magnitude from a random start; the noise of 5 % in the signals is hard to fit.
    assert!(report.last.distance < 0.05 * first.unwrap(), "{report:?} from {first:?}");
    let samples = insert(&case.background, &trainer.network, &on, 4);
    let metrics = measure(&problem, &samples, Some(&exact.samples)).unwrap();
    assert!(metrics.rmse_inside.unwrap() < 0.02, "{metrics:?}");
}

#[test]
fn training_has_the_same_bits_for_any_number_of_threads_and_when_resumed() {
    let case = Case::new(Objective::default(), Guidance::SUM);
    let problem = case.problem();
    let exact = solve(&problem).unwrap();
    let on = *problem.background.domain();
    let start = || {
        let architecture = Architecture::grid(&SHAPE, 1 << 10);
        let frame = Frame::of_cells(&on);
        let network = Network::new(architecture, frame, Output::of_range(0.0, 1.0), 1).unwrap();
        Trainer::new(network, TrainOptions { batch: 500, ..TrainOptions::default() })
    };
    let options = NeuralOptions { steps: 24, distill: 0.5, ..NeuralOptions::default() };
    let run = |trainer: &mut Trainer<2, 2>, until: u64| {
        train_blend(&problem, &exact, &on, trainer, &options, |p| p.step < until).unwrap();
    };
    let on_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut trainer = start();
            run(&mut trainer, 24);
            trainer.network.params().to_vec()
        })
    };
    let one = on_threads(1);
    assert!(one == on_threads(2) && one == on_threads(8));

    let mut trainer = start();
    run(&mut trainer, 11);
    assert_eq!(trainer.steps(), 11);
    // Everything that a checkpoint holds, and nothing else.
    let adam: Adam = trainer.adam.clone();
    let mut resumed = Trainer::resume(trainer.network.clone(), adam, trainer.options.clone());
    run(&mut resumed, 24);
    assert!(resumed.network.params() == one);
}

#[test]
fn networks_without_a_usable_gradient_are_refused() {
    let case = Case::new(Objective::default(), Guidance::Patch);
    let problem = case.problem();
    let exact = solve(&problem).unwrap();
    let on = *problem.background.domain();
    for architecture in [
        Architecture::hash(&SHAPE, 1 << 10),
        Architecture::diner(&SHAPE, Interpolation::Nearest, 3, 16, 1, 6.0),
        Architecture::diner(&SHAPE, Interpolation::Linear, 3, 16, 1, 6.0),
    ] {
        let network =
            Network::new(architecture, Frame::of_cells(&on), Output::of_range(0.0, 1.0), 1)
                .unwrap();
        let result = train_blend(
            &problem,
            &exact,
            &on,
            &mut Trainer::new(network, TrainOptions::default()),
            &NeuralOptions::default(),
            |_| true,
        );
        assert!(matches!(result, Err(Error::NoGradient)));
    }
}

#[test]
fn a_divergence_keeps_the_last_good_state_and_says_where() {
    let case = Case::new(Objective::default(), Guidance::Patch);
    let problem = case.problem();
    let exact = solve(&problem).unwrap();
    let on = *problem.background.domain();
    let architecture = Architecture::siren(32, 2, 30.0);
    let network =
        Network::new(architecture, Frame::of_cells(&on), Output::of_range(0.0, 1.0), 1).unwrap();
    let mut trainer = Trainer::new(network, TrainOptions { rate: 1e3, ..TrainOptions::default() });
    let result =
        train_blend(&problem, &exact, &on, &mut trainer, &NeuralOptions::default(), |_| true);
    let Err(Error::Network(inr_core::Error::Diverged { step, kept, .. })) = result else {
        panic!("{result:?}")
    };
    assert!(kept <= step && trainer.steps() == kept);
    assert!(trainer.network.params().iter().all(|p| p.is_finite()));
    let text = result.unwrap_err().to_string();
    assert!(text.contains(&format!("step {step}")) && text.contains("learning rate"), "{text}");
}
