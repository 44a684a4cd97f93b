//! Everything that decides the result of a fit, as it is written into unfinished files.

use std::time::Duration;

use inr_core::{FitOptions, Samples};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::args::{DEFAULT_SEED, FitArgs};
use crate::field_kind::{FieldKind, FieldOptions};

/// The kind of field, its numbers, the limits and the signal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// The kind of network.
    pub field: FieldKind,
    /// Its numbers, all that the kind has.
    pub options: FieldOptions,
    /// Seed of the first numbers and of the batches.
    pub seed: u64,
    /// Most steps.
    pub steps: Option<u64>,
    /// Most seconds.
    pub budget: Option<f64>,
    /// PSNR to stop at, in dB.
    pub target_psnr: Option<f64>,
    /// Fingerprint of the signal.
    pub signal: String,
}

impl Recipe {
    /// The recipe of a command line.
    ///
    /// # Errors
    /// A sentence about an option that the kind of field does not have.
    pub fn new(args: &FitArgs, signal: String) -> Result<Self, String> {
        let field = args.field.unwrap_or_default();
        // Time alone is a limit; a target alone may never be reached.
        let usual = || args.budget.is_none().then(|| field.steps());
        Ok(Self {
            field,
            options: field.resolve(&args.options)?,
            seed: args.seed.unwrap_or(DEFAULT_SEED),
            steps: args.steps.or_else(usual),
            budget: args.budget.map(|b| b.as_secs_f64()),
            target_psnr: args.target_psnr,
            signal,
        })
    }

    /// Where a command line asks for something else than this recipe, as what the file has and what
    /// was given.
    pub fn difference(&self, args: &FitArgs) -> Option<[String; 2]> {
        let ours = self.entries();
        let given = given(args);
        let (key, new) = given.iter().find(|(key, new)| ours.get(*key) != Some(*new))?;
        let flag = key.replace('_', "-");
        let words = |value: Option<&Value>| match value {
            None | Some(Value::Null) => format!("no --{flag}"),
            Some(Value::String(text)) => format!("--{flag} {text}"),
            Some(other) => format!("--{flag} {other}"),
        };
        Some([words(ours.get(key)), words(Some(new))])
    }

    /// The limits, for a signal whose largest value less its smallest is `peak`.
    pub fn fit_options(&self, peak: f32) -> FitOptions {
        FitOptions {
            steps: self.steps.unwrap_or(u64::MAX),
            budget: self.budget.and_then(|b| Duration::try_from_secs_f64(b).ok()),
            target_psnr: self.target_psnr,
            peak,
        }
    }

    fn entries(&self) -> Map<String, Value> {
        let mut all = self.options.given();
        all.insert("field".into(), self.field.name().into());
        all.insert("seed".into(), self.seed.into());
        all.insert("steps".into(), self.steps.into());
        all.insert("budget".into(), self.budget.into());
        all.insert("target_psnr".into(), self.target_psnr.into());
        all
    }
}

/// What a command line says about the recipe.
fn given(args: &FitArgs) -> Map<String, Value> {
    let mut all = args.options.given();
    let more = [
        ("field", args.field.map(|f| f.name().into())),
        ("seed", args.seed.map(Value::from)),
        ("steps", args.steps.map(Value::from)),
        ("budget", args.budget.map(|b| b.as_secs_f64().into())),
        ("target_psnr", args.target_psnr.map(Value::from)),
    ];
    all.extend(more.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?))));
    all
}

/// Sixteen digits that change with any bit of the values or the shape: FNV-1a over 32-bit words.
pub fn fingerprint<const D: usize, const C: usize>(samples: &Samples<D, C>) -> String {
    let shape = samples.domain().shape();
    let words = shape.into_iter().chain([C]).map(|n| n as u32);
    let all = words.chain(samples.as_planar().iter().map(|v| v.to_bits()));
    let hash = all.fold(0xcbf2_9ce4_8422_2325_u64, |hash, word| {
        (hash ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::args::{Cli, Command};

    fn parse(options: &str) -> FitArgs {
        let line = format!("npsolve fit a.png -o a.safetensors {options}");
        match Cli::parse_from(line.split_whitespace()).command {
            Command::Fit(args) => args,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn recipes_come_back_from_json() {
        for options in ["", "--field siren --omega 0.1 --rate 3e-5", "--budget 0.7 --seed 7"] {
            let recipe = Recipe::new(&parse(options), "ab".into()).unwrap();
            let text = serde_json::to_value(&recipe).unwrap().to_string();
            assert_eq!(serde_json::from_str::<Recipe>(&text).unwrap(), recipe, "{text}");
        }
    }

    #[test]
    fn only_what_is_given_can_differ() {
        let begun = "--field hash --width 32 --budget 2s --rate 0.01";
        let recipe = Recipe::new(&parse(begun), String::new()).unwrap();
        for same in ["", begun, "--budget 2000ms", "--depth 2", "--seed 1"] {
            assert_eq!(recipe.difference(&parse(same)), None, "{same}");
        }
        for (other, words) in [
            ("--width 64", ["--width 32", "--width 64"]),
            ("--steps 9", ["no --steps", "--steps 9"]),
            ("--omega 3", ["no --omega", "--omega 3.0"]),
            ("--field grid", ["--field hash", "--field grid"]),
            ("--target-psnr 30", ["no --target-psnr", "--target-psnr 30.0"]),
        ] {
            assert_eq!(recipe.difference(&parse(other)), Some(words.map(str::to_owned)));
        }
    }

    #[test]
    fn limits_have_defaults() {
        let steps = |options| Recipe::new(&parse(options), String::new()).unwrap().steps;
        assert_eq!(steps(""), Some(FieldKind::Grid.steps()));
        assert_eq!(steps("--target-psnr 40"), Some(FieldKind::Grid.steps()));
        assert_eq!((steps("--budget 1s"), steps("--budget 1s --steps 5")), (None, Some(5)));
    }

    #[test]
    fn fingerprints_differ() {
        let domain = inr_core::Domain::unit([2, 2]).unwrap();
        let print = |v| fingerprint(&Samples::<2, 1>::from_planar(domain, v).unwrap());
        let base = print(vec![0.0, 1.0, 2.0, 3.0]);
        assert_ne!(base, print(vec![-0.0, 1.0, 2.0, 3.0]));
        assert_ne!(base, print(vec![1.0, 0.0, 2.0, 3.0]));
        assert_eq!(base, print(vec![0.0, 1.0, 2.0, 3.0]));
    }
}
