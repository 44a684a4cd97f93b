//! Layers of OpenEXR pictures: some are blended, the others go from the background into the result as they are.

use anyhow::{Result, bail};
use signal_io::Image;

/// Both pictures with the channels to blend, under the background's names.
pub struct Chosen {
    /// The background's.
    pub background: Image,
    /// The patch's.
    pub patch: Image,
    /// The background with all of its channels, if these are not all.
    pub whole: Option<Image>,
}

/// The name of a channel's layer: what stands before its last dot; empty for channels of no layer.
fn layer_of(channel: &str) -> &str {
    channel.rsplit_once('.').map_or("", |(layer, _)| layer)
}

fn own_name(channel: &str) -> &str {
    channel.rsplit_once('.').map_or(channel, |(_, name)| name)
}

fn layers_of(image: &Image) -> Vec<&str> {
    let mut all = Vec::new();
    for channel in image.channels() {
        if !all.contains(&layer_of(channel)) {
            all.push(layer_of(channel));
        }
    }
    all
}

/// Chooses the layers named by the user (`main` for channels of no layer), else those that both pictures have. A patch
/// without layers goes into each of them. Pictures
/// without layers are left as they are, unless the patch has some of the background's channels only.
pub fn choose(
    background: Image,
    patch: Image,
    wanted: &[String],
    names: &[String; 2],
) -> Result<Chosen> {
    let (in_background, in_patch) = (layers_of(&background), layers_of(&patch));
    let fewer = patch.channels().len() < background.channels().len()
        && patch.channels().iter().all(|c| background.channels().contains(c));
    if wanted.is_empty() && in_background == [""] && in_patch == [""] && !fewer {
        return Ok(Chosen { background, patch, whole: None });
    }
    let plain = in_patch == [""];
    let chosen: Vec<&str> = match wanted {
        // A picture without layers goes where a picture is: to the colours.
        [] if plain => in_background.iter().copied().take(1).collect(),
        [] => in_background.iter().copied().filter(|l| in_patch.contains(l)).collect(),
        _ => wanted.iter().map(|l| if l == "main" { "" } else { l.as_str() }).collect(),
    };
    let say = |layers: &[&str]| {
        let words: Vec<&str> =
            layers.iter().map(|l| if l.is_empty() { "main" } else { l }).collect();
        words.join(", ")
    };
    for layer in &chosen {
        if !in_background.contains(layer) {
            bail!("{} has no layer {}; it has {}", names[0], say(&[layer]), say(&in_background));
        }
        if !plain && !in_patch.contains(layer) {
            bail!("{} has no layer {}; it has {}", names[1], say(&[layer]), say(&in_patch));
        }
    }
    // Pairs of channels of the same name; alpha is not blended.
    let mut pairs: Vec<(&str, &str)> = Vec::new();
    for channel in background.channels().iter().filter(|c| own_name(c) != "A") {
        if !chosen.contains(&layer_of(channel)) {
            continue;
        }
        let like = |p: &&String| match plain {
            true => own_name(p) == own_name(channel),
            false => *p == channel,
        };
        pairs.extend(patch.channels().iter().find(like).map(|p| (channel.as_str(), p.as_str())));
    }
    if pairs.is_empty() {
        bail!(
            "{} (layers {}) and {} (layers {}) have no channel in common; name layers of both with --layers",
            names[0],
            say(&in_background),
            names[1],
            say(&in_patch)
        );
    }
    let (ours, theirs): (Vec<&str>, Vec<&str>) = pairs.into_iter().unzip();
    let selected = background.select(&ours)?;
    let planes =
        theirs.iter().flat_map(|name| patch.plane_named(name).unwrap_or_default().to_vec());
    let mut inserted = Image::new(patch.width(), patch.height(), &ours, planes.collect())?;
    (inserted.sample, inserted.transfer) = (patch.sample, patch.transfer);
    inserted.icc = patch.icc.clone();
    let whole = (ours.len() < background.channels().len()).then_some(background);
    Ok(Chosen { background: selected, patch: inserted, whole })
}

/// The whole picture with these channels in their places.
pub fn put_back(whole: &Image, part: &Image) -> Image {
    let part = part.to_transfer(whole.transfer);
    let (mut out, n) = (whole.clone(), whole.pixel_count());
    for (c, name) in part.channels().iter().enumerate() {
        if let Some(k) = whole.channels().iter().position(|w| w == name) {
            out.as_planar_mut()[k * n..(k + 1) * n].copy_from_slice(part.plane(c));
        }
    }
    out.sample = part.sample;
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(channels: &[&str], first: f32) -> Image {
        let data = (0..channels.len()).flat_map(|c| [first + c as f32; 2]).collect();
        Image::new(2, 1, channels, data).unwrap()
    }

    fn chosen(b: &[&str], p: &[&str], wanted: &[&str]) -> Result<Vec<String>> {
        let wanted: Vec<String> = wanted.iter().map(|w| (*w).to_owned()).collect();
        let names = ["b.exr".to_owned(), "p.exr".to_owned()];
        let all = choose(image(b, 0.0), image(p, 50.0), &wanted, &names)?;
        assert_eq!(all.background.channels(), all.patch.channels());
        Ok(all.background.channels().to_vec())
    }

    #[test]
    fn layers_meet_by_name() {
        let layered = ["R", "G", "B", "diffuse.R", "diffuse.G", "diffuse.A", "depth.Z"];
        assert_eq!(chosen(&["R", "G", "B", "Z"], &["R", "G", "B"], &[]).unwrap(), ["R", "G", "B"]);
        assert_eq!(chosen(&layered, &["R", "G", "B"], &[]).unwrap(), ["R", "G", "B"]);
        assert_eq!(
            chosen(&layered, &["R", "G"], &["diffuse"]).unwrap(),
            ["diffuse.R", "diffuse.G"]
        );
        assert_eq!(chosen(&layered, &layered[3..6], &[]).unwrap(), ["diffuse.R", "diffuse.G"]);
        assert_eq!(chosen(&layered, &["R", "G", "B"], &["main"]).unwrap(), ["R", "G", "B"]);
        assert!(
            chosen(&layered, &["R"], &["gloss"])
                .unwrap_err()
                .to_string()
                .contains("b.exr has no layer gloss")
        );
        assert!(
            chosen(&layered, &layered[3..5], &["depth"])
                .unwrap_err()
                .to_string()
                .contains("p.exr has no")
        );
        assert!(
            chosen(&layered, &["Z"], &["diffuse"]).unwrap_err().to_string().contains("in common")
        );
    }

    #[test]
    fn what_is_not_chosen_stays() {
        let names = ["b".to_owned(), "p".to_owned()];
        let background = image(&["R", "a.R", "a.A"], 0.0);
        let all = choose(background, image(&["R"], 9.0), &["a".to_owned()], &names).unwrap();
        assert_eq!(all.patch.plane(0), [9.0, 9.0]);
        let out = put_back(&all.whole.unwrap(), &all.patch);
        assert_eq!(out.as_planar(), [0.0, 0.0, 9.0, 9.0, 2.0, 2.0]);
    }
}
