//! Layers of OpenEXR pictures.

use signal_io::{Image, ReadOptions, SampleType, Transfer, read_image};

use crate::support::{Folder, smooth};

fn read(folder: &Folder, name: &str) -> Image {
    read_image(folder.path(name), &ReadOptions::default()).unwrap()
}

/// Two layers of colours, depth and a matte.
fn layered(constant: f32) -> Image {
    let names = ["R", "G", "B", "light.R", "light.G", "light.B", "light.A", "depth.Z"];
    let waves = smooth(32, 24, 8, 0.4);
    let mut data = waves.as_planar().to_vec();
    data[..6 * 32 * 24].iter_mut().for_each(|v| *v = 0.5 * *v + constant);
    let mut image = Image::new(32, 24, &names, data).unwrap();
    image.transfer = Transfer::Linear;
    image
}

#[test]
fn chosen_layers_are_blended_and_the_others_copied() {
    let folder = Folder::new();
    folder.picture("b.exr", &layered(0.0), SampleType::F32);
    folder.picture("p.exr", &layered(0.2), SampleType::F32);
    let mut grey = smooth(32, 24, 1, 0.0);
    grey.transfer = Transfer::Linear;
    let mut rgb = grey.to_rgb().unwrap();
    rgb.transfer = Transfer::Linear;
    folder.picture("rgb.exr", &rgb, SampleType::F32);
    let background = read(&folder, "b.exr");
    let region = "--region box:9,8:21,16 --domain stored";
    let changed = |image: &Image| -> Vec<String> {
        let same = |c: &usize| image.plane(*c) == background.plane(*c);
        let all = 0..image.channels().len();
        all.filter(|c| !same(c)).map(|c| image.channels()[c].clone()).collect()
    };
    folder.run(&format!("blend b.exr rgb.exr {region} --layers light -o a.exr")).ok();
    assert_eq!(changed(&read(&folder, "a.exr")), ["light.R", "light.G", "light.B"]);
    folder.run(&format!("blend b.exr rgb.exr {region} -o c.exr")).ok();
    assert_eq!(changed(&read(&folder, "c.exr")), ["R", "G", "B"]);

    // A constant on top of all colours: the blend is the background, in every layer that both have.
    folder.run(&format!("blend b.exr p.exr {region} -o d.exr")).ok();
    let blend = read(&folder, "d.exr");
    assert_eq!(blend.channels(), background.channels());
    let off = blend.as_planar().iter().zip(background.as_planar()).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f32::max) < 1e-5);

    folder
        .run(&format!("blend b.exr rgb.exr {region} --layers gloss -o x.exr"))
        .fails(1, &["b.exr", "gloss", "main, depth, light"]);
    folder
        .run(&format!("blend b.exr p.exr {region} --gray --layers light -o x.exr"))
        .fails(1, &["--gray"]);
    assert!(!folder.path("x.exr").exists());
}

#[test]
fn the_problem_comes_along_as_layers() {
    let folder = Folder::new();
    for (name, lift) in [("b.exr", 0.0), ("p.exr", 0.3)] {
        let mut image = smooth(32, 24, 3, 0.4);
        image.as_planar_mut().iter_mut().for_each(|v| *v = 0.5 * *v + lift);
        image.transfer = Transfer::Linear;
        folder.picture(name, &image, SampleType::F32);
    }
    let command = "blend b.exr p.exr --region box:9,8:21,16 --domain stored";
    folder.run(&format!("{command} --with gradient,guidance,residual,region -o o.exr")).ok();
    let image = read(&folder, "o.exr");
    assert_eq!(image.channels().len(), 3 + 6 + 6 + 6 + 1);
    let plane = |name: &str| image.plane_named(name).unwrap_or_else(|| panic!("{name}"));
    assert_eq!(plane("region.Y").iter().sum::<f32>(), 12.0 * 8.0);
    // The guidance is the gradient of the background here, and so is the result's.
    for channel in ["R", "G", "B"] {
        for axis in ["x", "y"] {
            let worst = |name: &str| {
                plane(&format!("{name}_{axis}.{channel}"))
                    .iter()
                    .fold(0.0f32, |a, v| a.max(v.abs()))
            };
            assert!(worst("residual") < 1e-5 && worst("gradient") > 0.01, "{channel} {axis}");
        }
        // Independent truth: the spline's slope at a sample, by central differences of neighbours in a smooth wave.
        let (values, slopes) = (plane(channel), plane(&format!("gradient_x.{channel}")));
        let k = 12 * 32 + 15;
        assert!((slopes[k] - 0.5 * (values[k + 1] - values[k - 1])).abs() < 3e-3);
    }
    folder.run(&format!("{command} --with gradient -o x.png")).fails(1, &["x.png", ".exr"]);
    folder.run(&format!("{command} --with speed -o x.exr")).fails(2, &["gradient"]);
}
