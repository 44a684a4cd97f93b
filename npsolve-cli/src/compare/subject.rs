//! Problems of every kind of signal, ready to be compared on.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use inr_core::Region;
use signal_io::{Image, SampleType, WriteOptions};

use crate::args::{CompareArgs, ObjectiveName, SceneArgs};
use crate::channels::{Axes, Channels};
use crate::files;
use crate::kind::SignalKind;
use crate::scene;
use crate::signals::{self, Signal, audio, light_field, video, volume};
use crate::solve::Settings;

use super::canvas::Canvas;
use super::methods::{Case, TOLERANCE};
use super::{Shown, Visitor, sheet};

/// Files and how they are put together.
pub struct Subject<'a> {
    /// Of both files.
    pub kind: SignalKind,
    /// What stays outside.
    pub background: &'a Path,
    /// What goes in.
    pub patch: &'a Path,
    /// Where.
    pub scene: &'a SceneArgs,
    /// Everything else.
    pub args: &'a CompareArgs,
}

impl Subject<'_> {
    /// Reads the files and hands the case over.
    pub fn open<V: Visitor>(&self, visitor: V) -> Result<V::Output> {
        let Self { background, patch, scene, .. } = *self;
        match self.kind {
            SignalKind::Image => self.picture(visitor),
            SignalKind::Audio => {
                let all = audio::Scene::read(background, patch, scene)?;
                let settings =
                    audio::in_frames(self.settings(), scene.mode, all.background.rate_hz());
                let (_, excerpt) = all.excerpt(&settings, scene)?;
                self.signal(&excerpt, settings, visitor)
            }
            SignalKind::Volume => {
                let all = volume::Scene::read(background, patch, scene)?;
                self.signal(&all, self.settings(), visitor)
            }
            SignalKind::Video => {
                let all = video::Scene::read(background, patch, scene)?;
                self.signal(&all, self.settings(), visitor)
            }
            SignalKind::Lightfield => {
                let all = light_field::Scene::read(background, patch, scene)?;
                self.signal(&all, self.settings(), visitor)
            }
        }
    }

    fn settings(&self) -> Settings {
        let solve = &self.args.solve;
        Settings {
            guidance: solve.guidance,
            options: solve.options(ObjectiveName::Screened, TOLERANCE),
        }
    }

    fn picture<V: Visitor>(&self, visitor: V) -> Result<V::Output> {
        let scene = scene::Scene::read(self.background, self.patch, self.scene)?;
        let other = |path: &PathBuf| {
            let picture = scene.like_background(path, self.scene.gray)?;
            Ok((path.clone(), picture.as_planar().to_vec()))
        };
        let others = self.args.other.iter().map(other).collect::<Result<_>>()?;
        let region = scene.region();
        let case =
            Case::new(scene.setup(&region), &scene.warnings, &self.settings(), self.args, others);
        visitor.visit(case, &Picture(&scene))
    }

    fn signal<S: Signal<D>, V: Visitor, const D: usize>(
        &self,
        scene: &signals::Scene<S, D>,
        settings: Settings,
        visitor: V,
    ) -> Result<V::Output>
    where
        Axes<D>: Channels,
    {
        if let Some(other) = self.args.other.first() {
            bail!("--other is for pictures; {} cannot take part", other.display());
        }
        let region = scene.job.region();
        let region: &dyn Region<D> = &region;
        let setup = scene.job.setup(region);
        let case = Case::new(setup, &scene.warnings, &settings, self.args, Vec::new());
        let unit = self.kind.length_unit();
        visitor.visit(case, &Whole { scene, unit })
    }
}

/// Results of pictures.
struct Picture<'a>(&'a scene::Scene);

impl Shown for Picture<'_> {
    /// A format that holds every result: floats stay floats, integers are clamped as in `blend`.
    fn ending(&self) -> &'static str {
        let background: &Image = &self.0.background;
        match (background.channels().len(), background.sample) {
            (1 | 3, SampleType::U8 | SampleType::U16) => ".png",
            (1 | 3, _) => ".exr",
            _ => ".npy",
        }
    }

    fn unit(&self) -> &'static str {
        SignalKind::Image.length_unit()
    }

    fn view(&self, planes: &[f32]) -> Result<Canvas> {
        Canvas::from_image(&self.0.picture(planes.to_vec(), false)?)
    }

    fn around(&self, planes: &[f32]) -> Result<Canvas> {
        sheet::around(self.0, planes)
    }

    fn save(&self, planes: &[f32], path: &Path, force: bool) -> Result<()> {
        let options = WriteOptions { force, ..WriteOptions::default() };
        files::write(path, &self.0.picture(planes.to_vec(), false)?, &options)?;
        Ok(())
    }
}

/// Results of other signals: the picture through the middle of the region is shown.
struct Whole<'a, S, const D: usize> {
    scene: &'a signals::Scene<S, D>,
    unit: &'static str,
}

impl<S: Signal<D>, const D: usize> Whole<'_, S, D> {
    fn result(&self, planes: &[f32]) -> Result<S> {
        let mut planes = planes.to_vec();
        self.scene.job.to_stored(&mut planes);
        self.scene.background.with_values(&planes)
    }
}

impl<S: Signal<D>, const D: usize> Shown for Whole<'_, S, D> {
    fn ending(&self) -> &'static str {
        self.scene.background.ending()
    }

    fn unit(&self) -> &'static str {
        self.unit
    }

    fn view(&self, planes: &[f32]) -> Result<Canvas> {
        let background = &self.scene.background;
        Canvas::from_image(&self.result(planes)?.picture(self.scene.job.middle(), background)?)
    }

    fn save(&self, planes: &[f32], path: &Path, force: bool) -> Result<()> {
        self.result(planes)?.save(path, force)
    }
}
