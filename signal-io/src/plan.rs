use crate::error::Fault;
use crate::{Format, Image, SampleType, Transfer, WriteOptions};

/// How a picture goes into a file: decided before the first byte is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Plan {
    pub(crate) format: Format,
    pub(crate) sample: SampleType,
    pub(crate) transfer: Transfer,
    pub(crate) jpeg_quality: u8,
    /// A PNM file in its general form, which names its channels.
    pub(crate) is_pam: bool,
    /// The format has three colour channels only, the picture has one.
    broadcast: bool,
}

impl Plan {
    pub(crate) fn new(
        format: Format,
        extension: &str,
        image: &Image,
        options: &WriteOptions,
    ) -> Result<Self, Fault> {
        let sample = choose_sample(format, image, options.sample)?;
        check_channels(format, extension, image)?;
        check_size(format, image.width(), image.height())?;
        let transfer = match (format, sample, image.transfer) {
            (Format::Npy, _, stored) => stored,
            (Format::Tiff, SampleType::F16 | SampleType::F32, stored) => stored,
            (_, _, Transfer::Unspecified) => Transfer::Unspecified,
            (Format::Exr | Format::Hdr | Format::Pfm, ..) => Transfer::Linear,
            _ => Transfer::Srgb,
        };
        let one_color = image.color_count() == 1;
        let broadcast = one_color && (format == Format::Hdr || extension == "ppm");
        let jpeg_quality = options.jpeg_quality.clamp(1, 100);
        Ok(Self { format, sample, transfer, jpeg_quality, is_pam: extension == "pam", broadcast })
    }

    /// The picture in the encoding and with the channels of the file.
    pub(crate) fn prepare(&self, image: &Image) -> Result<Image, Fault> {
        let out = image.to_transfer(self.transfer);
        Ok(if self.broadcast { out.to_rgb()? } else { out })
    }
}

/// The number types a format stores, the preferred stand-in for others, and where to go instead.
fn choose_sample(
    format: Format,
    image: &Image,
    wanted: Option<SampleType>,
) -> Result<SampleType, Fault> {
    use SampleType::{F16, F32, U8, U16};
    let (types, instead): (&[SampleType], &str) = match format {
        Format::Png | Format::Pnm => {
            (&[U8, U16], "write .exr, .tif or .npy for floats, or ask for 8 or 16 bits")
        }
        Format::Jpeg | Format::WebP | Format::Gif => {
            (&[U8], "write .png or .tif for 16 bits and .exr, .tif or .npy for floats")
        }
        Format::Tiff => (&[U8, U16, F32], "ask for float, or write .exr for half floats"),
        Format::Hdr | Format::Pfm => (&[F32], "write .png or .tif for integers, .exr for halves"),
        Format::Exr => (&[F16, F32], "write .png, .tif or .npy for integers"),
        Format::Npy => (&[U8, U16, F16, F32], ""),
    };
    match wanted {
        Some(sample) if types.contains(&sample) => Ok(sample),
        Some(sample) => Err(Fault::cannot_hold_sample(sample, instead)),
        None if types.contains(&image.sample) => Ok(image.sample),
        // The widest type loses least: 16 bits for floats in PNG, float for integers in EXR.
        None => Ok(types[types.len() - 1]),
    }
}

/// Which channels a format has.
fn check_channels(format: Format, extension: &str, image: &Image) -> Result<(), Fault> {
    let (colors, alpha) = (image.color_count(), image.alpha().is_some());
    let what = || match (colors, alpha) {
        (0, _) => "alpha alone".to_owned(),
        (n, false) => {
            format!("{n} colour channel{} ({})", if n == 1 { "" } else { "s" }, names(image))
        }
        (n, true) => format!("{n} colour channel{} and alpha", if n == 1 { "" } else { "s" }),
    };
    let (fits, instead) = match (format, extension) {
        (Format::Exr | Format::Npy, _) | (Format::Pnm, "pam") => (true, ""),
        (Format::Jpeg | Format::Hdr | Format::Pfm, _) => (
            matches!(colors, 1 | 3) && !alpha,
            match alpha {
                true => "drop alpha (split_alpha), or write .png, .tif or .exr",
                false => "choose channels (select, to_gray), or write .exr or .npy",
            },
        ),
        (Format::Pnm, "pgm") => (colors == 1 && !alpha, "write .ppm for colours, .pam for alpha"),
        (Format::Pnm, _) => (matches!(colors, 1 | 3) && !alpha, "write .pam or .png"),
        _ => (matches!(colors, 1 | 3), "write .exr or .npy, or choose channels (select, to_gray)"),
    };
    match fits {
        true => Ok(()),
        false => Err(Fault::cannot_hold(what(), instead)),
    }
}

fn names(image: &Image) -> String {
    let mut list: Vec<&str> = image.channels().iter().take(8).map(String::as_str).collect();
    if image.channels().len() > list.len() {
        list.push("...");
    }
    list.join(", ")
}

/// The longest side a format can state in its header.
pub(crate) fn check_size(format: Format, w: usize, h: usize) -> Result<(), Fault> {
    let side = match format {
        Format::WebP => 16_384, // 14 bits, counted from one.
        Format::Jpeg | Format::Gif => 65_535,
        _ => i32::MAX as usize,
    };
    match w <= side && h <= side {
        true => Ok(()),
        false => Err(Fault::cannot_hold(
            format!("{w} x {h} pixels"),
            format!("its longest side is {side}; write .png, .tif, .exr or .npy"),
        )),
    }
}
