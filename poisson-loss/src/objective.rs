use crate::{Error, Result};

/// The functional that a blend minimises. `c` is the blend, `c_S` the background, `c_T` the
/// patch, `Omega` the region, and gradients are per reference pitch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Objective {
    /// `1/|Omega| [ int_S |grad c - v|^2 + l^-2 int_{S-Omega} |c - c_S|^2 + l_in^-2 int_Omega |c - c_T|^2 ]`.
    ///
    /// The change of the background decays as `exp(-d/l)` away from the region. Lengths are in
    /// the units of the background's domain.
    Screened {
        /// `l`; default 0.04 times the region's inradius, at least two reference pitches.
        length: Option<f32>,
        /// `l_in`: how far from the edge the patch's own colours give way; default infinite.
        keep: Option<f32>,
    },
    /// The paper's functional: `mean_Omega |grad c - v|^2 + lambda mean_{S-Omega} |c - c_S|^2`.
    ///
    /// Depends on the sampling density (the continuum limit has no coupling at all), so it is
    /// for reproduction, not for work. Useful lambdas are 1 to 10.
    Paper {
        /// Weight of the colour term.
        lambda: f32,
    },
    /// Values fixed to the background outside the region: the limit `l -> 0`, classical PIE.
    Dirichlet,
}

impl Default for Objective {
    fn default() -> Self {
        Self::Screened { length: None, keep: None }
    }
}

/// Everything about a solve that is not the signals themselves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// The functional.
    pub objective: Objective,
    /// Colour weight outside grows as `(1 + d/l)^2` with the distance `d`: locks the far background.
    pub ramp: bool,
    /// Ten times the colour weight within two reference pitches of the region: the background is
    /// nearly untouched.
    pub band: bool,
    /// Width, in the units of the domain, over which the guidance fades from the background's
    /// gradient to `v` inside the region's edge; for masks that cut through an object. 0 for none.
    pub feather: f32,
    /// Stop when the preconditioned residual has fallen by this factor: 1e-4 is invisible in
    /// 8-bit pictures (0.02 levels RMS), 1e-6 is f32 accuracy.
    pub tolerance: f32,
    /// Give up after this many iterations. Up to 20 are usual; [`Objective::Paper`] in five dimensions, whose values
    /// outside have a condition in splines that grows ninefold per axis, takes up to 260.
    pub max_iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            objective: Objective::default(),
            ramp: false,
            band: false,
            feather: 0.0,
            tolerance: 1e-6,
            max_iterations: 1000,
        }
    }
}

impl Options {
    /// Options with a given functional.
    pub fn with_objective(objective: Objective) -> Self {
        Self { objective, ..Self::default() }
    }

    /// # Errors
    /// [`Error::Parameter`] for the first option that is out of range.
    pub fn validate(&self) -> Result<()> {
        let positive = |name, value: Option<f32>| match value {
            Some(v) if !(v > 0.0 && v.is_finite()) => {
                Err(Error::Parameter { name, rule: "positive and finite", value: f64::from(v) })
            }
            _ => Ok(()),
        };
        match self.objective {
            Objective::Screened { length, keep } => {
                positive("length", length)?;
                positive("keep", keep)?;
            }
            Objective::Paper { lambda } => positive("lambda", Some(lambda))?,
            Objective::Dirichlet => {}
        }
        if !(self.feather >= 0.0 && self.feather.is_finite()) {
            let value = f64::from(self.feather);
            return Err(Error::Parameter {
                name: "feather",
                rule: "zero or positive and finite",
                value,
            });
        }
        if !(self.tolerance > 0.0 && self.tolerance < 1.0) {
            let value = f64::from(self.tolerance);
            return Err(Error::Parameter { name: "tolerance", rule: "between 0 and 1", value });
        }
        Ok(())
    }
}
