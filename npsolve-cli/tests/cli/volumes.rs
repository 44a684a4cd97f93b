//! Volumes in every format, and meshes as their regions.

use serde_json::Value;
use signal_io::{
    Volume, VolumeReadOptions, VolumeWriteOptions, VoxelType, read_image, read_volume, write_volume,
};

use crate::support::Folder;

const SHAPE: [usize; 3] = [22, 18, 14];
const AFFINE: [[f64; 4]; 3] = [[2.0, 0.0, 0.0, -20.0], [0.0, 2.0, 0.0, 5.0], [0.0, 0.0, 3.0, 0.0]];

/// Waves plus a constant; where it lies is left out for formats that cannot say so.
fn volume(constant: f32, affine: Option<[[f64; 4]; 3]>) -> Volume {
    let value = |k: usize| {
        let [x, y, z] = [k % 22, k / 22 % 18, k / 22 / 18].map(|v| v as f32);
        (100.0 + 30.0 * (0.4 * x).sin() + 20.0 * (0.3 * y - 0.2 * z).cos() + constant).round()
    };
    let mut volume =
        Volume::new(SHAPE, 1, (0..SHAPE.iter().product()).map(value).collect()).unwrap();
    if let Some(affine) = affine {
        volume = volume.with_affine(affine).unwrap();
    }
    volume.voxel_type = VoxelType::U16;
    volume
}

fn write(folder: &Folder, name: &str, volume: &Volume) {
    write_volume(folder.path(name), volume, &VolumeWriteOptions::default()).unwrap();
}

fn read(folder: &Folder, name: &str) -> Volume {
    read_volume(folder.path(name), &VolumeReadOptions::default()).unwrap()
}

fn json(folder: &Folder, command: &str) -> Value {
    let run = folder.run(&format!("{command} --json")).ok();
    serde_json::from_str(&run.stdout()).expect("JSON")
}

#[test]
fn every_format_goes_in_and_out() {
    let folder = Folder::new();
    let formats = ["nii", "nii.gz", "nrrd", "npy", "tif", "json"];
    for (k, end) in formats.into_iter().enumerate() {
        // Neighbours in the list meet, so that formats with and without a place do, too.
        let (from, to) = (format!("p{k}.{end}"), format!("o{k}.{}", formats[(k + 1) % 6]));
        let place = |name: &str| (!["npy", "tif"].contains(&name)).then_some(AFFINE);
        let background = volume(0.0, place(end));
        write(&folder, &format!("b{k}.{end}"), &background);
        write(&folder, &from, &volume(40.0, place(end)));
        let command = format!("blend b{k}.{end} {from} --region box:5,4,3:15,13,10 -o {to}");
        let report = json(&folder, &command);
        assert_eq!((&report["kind"], &report["region_samples"]), (&"volume".into(), &630.0.into()));
        let blend = read(&folder, &to);
        assert_eq!(blend.as_planar(), background.as_planar(), "{command}");
        assert_eq!(blend.voxel_type, VoxelType::U16);
        folder.run(&format!("render {to} -o v{k}.png")).ok();
        let sheet = read_image(folder.path(&format!("v{k}.png")), &Default::default()).unwrap();
        assert!(sheet.width() > 60, "{to}: {}", sheet.width());
        assert_eq!(json(&folder, &format!("inspect {to}"))[0]["size"], serde_json::json!(SHAPE));
    }
}

/// A box from `low` to `high` as a .glb; `open` leaves the last side away.
fn mesh(low: [f32; 3], high: [f32; 3], open: bool) -> Vec<u8> {
    const SIDES: [[usize; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let corner = |k: usize| [0, 1, 2].map(|d| if k >> d & 1 == 1 { high[d] } else { low[d] });
    let sides = &SIDES[..if open { 5 } else { 6 }];
    let corners = sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]);
    let binary: Vec<u8> = corners.flat_map(|k| corner(k).map(f32::to_le_bytes).concat()).collect();
    let mut json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": {}, "type": "VEC3"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": {n}}}], "buffers": [{{"byteLength": {n}}}]}}"#,
        6 * sides.len(),
        n = binary.len()
    );
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let word = |n: usize| (n as u32).to_le_bytes();
    let (head, length) = (*b"glTF\x02\0\0\0", word(28 + json.len() + binary.len()));
    let chunk = |kind: &[u8; 4], data: &[u8]| [&word(data.len()), &kind[..], data].concat();
    [&head[..], &length, &chunk(b"JSON", json.as_bytes()), &chunk(b"BIN\0", &binary)].concat()
}

#[test]
fn closed_meshes_are_regions() {
    let folder = Folder::new();
    let background = volume(0.0, Some(AFFINE));
    write(&folder, "b.nii", &background);
    write(&folder, "p.nii", &volume(40.0, Some(AFFINE)));
    // Voxels 5 to 14, 4 to 12 and 3 to 9 in the world's millimetres.
    let corner = |i: [f64; 3]| background.to_world(i).map(|v| v as f32);
    let (low, high) = (corner([4.5, 3.5, 2.5]), corner([14.5, 12.5, 9.5]));
    std::fs::write(folder.path("mm.glb"), mesh(low, high, false)).unwrap();
    let metres = |corner: [f32; 3]| corner.map(|v| 1e-3 * v);
    std::fs::write(folder.path("m.glb"), mesh(metres(low), metres(high), false)).unwrap();
    std::fs::write(folder.path("smp.glb"), mesh([4.5, 3.5, 2.5], [14.5, 12.5, 9.5], false))
        .unwrap();
    for region in ["mm.glb", "mm.glb:mm", "m.glb:m", "smp.glb:smp"] {
        let command = format!("blend b.nii p.nii --region {region} -o o.nii --force");
        assert_eq!(json(&folder, &command)["region_samples"], 630.0, "{region}");
        assert_eq!(read(&folder, "o.nii").as_planar(), background.as_planar(), "{region}");
    }
    std::fs::write(folder.path("open.glb"), mesh(low, high, true)).unwrap();
    let run = |region: &str| folder.run(&format!("blend b.nii p.nii --region {region} -o x.nii"));
    run("open.glb").fails(1, &["open.glb", "closed"]);
    run("missing.glb").fails(1, &["missing.glb"]);
    run("m.glb").fails(1, &["--region"]);
    folder.run("blend b.nii p.nii --region head.obj -o x.nii").fails(2, &[".glb"]);
    assert!(!folder.path("x.nii").exists());
}
