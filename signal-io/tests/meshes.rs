//! glTF scenes become triangles in one space; damaged ones become typed errors.

mod support;

use inr_core::{BoxRegion, Region};
use signal_io::{Error, Mesh, Result, decode_mesh, read_mesh};
use support::random;

const LIMIT: u64 = 1 << 28;

/// The box from -1 to 1: corner `k` has coordinate `d` at +1 where bit `d` is set.
const SIDES: [[u8; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// 96 bytes of corners, 36 of indices.
fn box_bytes() -> Vec<u8> {
    let coordinate = |k: u8, d: u8| if k >> d & 1 == 1 { 1.0f32 } else { -1.0 };
    let corners = (0..8u8).flat_map(|k| (0..3).map(move |d| coordinate(k, d)));
    let mut out: Vec<u8> = corners.flat_map(f32::to_le_bytes).collect();
    out.extend(SIDES.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]));
    out
}

/// A scene around the box: `nodes` is JSON, `more` other fields, each with a comma before.
fn scene(nodes: &str, more: &str, uri: &str) -> String {
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": {nodes},
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"}},
                      {{"bufferView": 1, "componentType": 5121, "count": 36, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 96}}, {{"buffer": 0, "byteOffset": 96, "byteLength": 36}}],
        "buffers": [{{"byteLength": 132{uri}}}]{more}}}"#
    )
}

fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(binary);
    out
}

fn decode(bytes: &[u8]) -> Result<Mesh> {
    let result = decode_mesh("scene.glb", bytes, LIMIT);
    if let Err(error) = &result {
        assert!(error.to_string().contains("scene.glb"), "{error}");
    }
    result
}

fn boxed(nodes: &str) -> Result<Mesh> {
    decode(&glb(&scene(nodes, "", ""), &box_bytes()))
}

/// Against the box between two corners, at points all around.
fn assert_is_box(mesh: &Mesh, min: [f32; 3], max: [f32; 3]) {
    let (region, exact) = (mesh.to_region().unwrap(), BoxRegion::new(min, max).unwrap());
    let mut next = random(3);
    for _ in 0..300 {
        let x = std::array::from_fn(|d| {
            let part = (next() >> 40) as f32 / (1u32 << 24) as f32;
            min[d] - 1.0 + part * (max[d] - min[d] + 2.0)
        });
        let (got, want) = (region.signed_distance(&x), exact.signed_distance(&x));
        assert!((got - want).abs() < 1e-5, "{x:?}: {got} {want}");
    }
}

#[test]
fn transforms_of_nodes_are_applied() {
    assert_is_box(&boxed(r#"[{"mesh": 0}]"#).unwrap(), [-1.0; 3], [1.0; 3]);
    // A quarter turn about z of a box that is 2 by 4 by 6, moved by its parent; a reflection besides.
    let quarter = std::f64::consts::FRAC_1_SQRT_2;
    for x_scale in [1, -1] {
        let nodes = format!(
            r#"[{{"children": [1], "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 10,20,30,1]}},
            {{"mesh": 0, "rotation": [0, 0, {quarter}, {quarter}], "scale": [{x_scale}, 2, 3], "translation": [1, 0, 0]}}]"#
        );
        let mesh = boxed(&nodes).unwrap();
        assert_is_box(&mesh, [9.0, 19.0, 27.0], [13.0, 21.0, 33.0]);
        // The front stays outside: the volume by the divergence theorem.
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|k| mesh.vertices[k as usize].map(f64::from));
                (a[0] * (b[1] * c[2] - b[2] * c[1])
                    + a[1] * (b[2] * c[0] - b[0] * c[2])
                    + a[2] * (b[0] * c[1] - b[1] * c[0]))
                    / 6.0
            })
            .sum();
        assert!((volume - 48.0).abs() < 1e-3, "{volume}");
    }
    let map = [[0.0, 0.0, 1000.0, 5.0], [1000.0, 0.0, 0.0, 0.0], [0.0, 1000.0, 0.0, 0.0]];
    let moved =
        boxed(r#"[{"mesh": 0, "scale": [0.001, 0.002, 0.003]}]"#).unwrap().transformed(&map);
    assert_is_box(&moved, [2.0, -1.0, -2.0], [8.0, 1.0, 2.0]);
}

#[test]
fn buffers_are_inside_or_beside() {
    let bytes = box_bytes();
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let text: String = bytes
        .chunks(3)
        .flat_map(|c| {
            let word = u32::from(c[0]) << 16 | u32::from(c[1]) << 8 | u32::from(c[2]);
            [18, 12, 6, 0].map(|shift| DIGITS[(word >> shift & 63) as usize] as char)
        })
        .collect();
    let inside = format!(r#", "uri": "data:application/octet-stream;base64,{text}""#);
    let mesh = decode(scene(r#"[{"mesh": 0}]"#, "", &inside).as_bytes()).unwrap();
    assert_is_box(&mesh, [-1.0; 3], [1.0; 3]);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("box.gltf");
    let beside = scene(r#"[{"mesh": 0}]"#, "", r#", "uri": "my%20box.bin""#);
    std::fs::write(&path, &beside).unwrap();
    let missing = read_mesh(&path, LIMIT);
    assert!(matches!(missing, Err(Error::NotFound { path }) if path.ends_with("my box.bin")));
    std::fs::write(folder.path().join("my box.bin"), &bytes).unwrap();
    assert_eq!(read_mesh(&path, LIMIT).unwrap(), mesh);
    assert!(matches!(decode(beside.as_bytes()), Err(Error::UnsupportedFeature { .. })));
    std::fs::write(folder.path().join("my box.bin"), &bytes[1..]).unwrap();
    assert!(matches!(read_mesh(&path, LIMIT), Err(Error::Corrupt { .. })));
}

#[test]
fn what_the_format_forbids_is_a_typed_error() {
    let corrupt = |result: &Result<Mesh>| matches!(result, Err(Error::Corrupt { .. }));
    for nodes in [
        r#"[{"children": [0], "mesh": 0}]"#,
        r#"[{"children": [1]}, {"children": [0], "mesh": 0}]"#,
        r#"[{"children": [1, 2]}, {"children": [2]}, {"mesh": 0}]"#,
        r#"[{"children": [7]}]"#,
        r#"[{"mesh": 3}]"#,
        r#"[]"#,
        r#"[{"mesh": 0, "scale": [1e300, 1, 1]}]"#,
    ] {
        assert!(corrupt(&boxed(nodes)), "{nodes}: {:?}", boxed(nodes));
    }
    let whole = scene(r#"[{"mesh": 0}]"#, "", "");
    for (from, to) in [
        (r#""scenes": [{"nodes": [0]}],"#, r#""scene": 2,"#),
        (r#""count": 36"#, r#""count": 37"#),
        (r#""count": 36"#, r#""count": 35"#),
        (r#""count": 8"#, r#""count": 18446744073709551615"#),
        (r#""count": 8"#, r#""count": 1099511627776"#),
        (r#""count": 8"#, r#""count": 7"#), // A corner without vertex.
        (r#""byteLength": 96}"#, r#""byteLength": 96, "byteStride": 4}"#),
        (r#""byteLength": 36"#, r#""byteLength": 18446744073709551615"#),
        (r#""byteOffset": 96"#, r#""byteOffset": 18446744073709551615"#),
        (r#""bufferView": 1"#, r#""bufferView": 2"#),
        (r#""buffer": 0"#, r#""buffer": 1"#),
        (r#""POSITION": 0"#, r#""POSITION": 5"#),
        (r#""indices": 1"#, r#""indices": 9"#),
        (r#""indices": 1"#, r#""indices": 1, "mode": 9"#),
        (r#""byteLength": 132"#, r#""byteLength": 133"#),
        ("5121", "5130"),
    ] {
        assert!(whole.contains(from), "{from}");
        let result = decode(&glb(&whole.replacen(from, to, 1), &box_bytes()));
        assert!(corrupt(&result), "{from} -> {to}: {result:?}");
    }
    for (from, to) in [
        (r#""version": "2.0""#, r#""version": "1.0""#),
        (r#""type": "VEC3""#, r#""type": "VEC3", "sparse": {"count": 1}"#),
        (r#""indices": 1"#, r#""indices": 1, "extensions": {"KHR_draco_mesh_compression": {}}"#),
        (r#""bufferView": 0, "#, ""),
        ("5126", "5123"),
    ] {
        let result = decode(&glb(&whole.replacen(from, to, 1), &box_bytes()));
        assert!(
            matches!(result, Err(Error::UnsupportedFeature { .. })),
            "{from} -> {to}: {result:?}"
        );
    }
    let draco =
        scene(r#"[{"mesh": 0}]"#, r#", "extensionsRequired": ["KHR_draco_mesh_compression"]"#, "");
    let error = decode(&glb(&draco, &box_bytes())).unwrap_err();
    assert!(error.to_string().contains("KHR_draco_mesh_compression"), "{error}");

    assert!(matches!(decode(b""), Err(Error::Empty { .. })));
    assert!(matches!(boxed("[{}]"), Err(Error::Empty { .. })));
    let nan = [&f32::NAN.to_le_bytes()[..], &box_bytes()[4..]].concat();
    assert!(corrupt(&decode(&glb(&whole, &nan))));
}

#[test]
fn instances_cannot_fill_the_memory() {
    // Two to the 30th boxes, if a node could have two parents; and 20000 honest ones.
    let doubling: Vec<String> = (1..31).map(|k| format!(r#"{{"children": [{k}, {k}]}}"#)).collect();
    let nodes = format!(r#"[{}, {{"mesh": 0}}]"#, doubling.join(","));
    assert!(matches!(boxed(&nodes), Err(Error::Corrupt { .. })));
    let children: Vec<String> = (1..20_001).map(|k| k.to_string()).collect();
    let nodes = format!(
        r#"[{{"children": [{}]}}{}]"#,
        children.join(","),
        r#", {"mesh": 0}"#.repeat(20_000)
    );
    let bytes = glb(&scene(&nodes, "", ""), &box_bytes());
    let result = decode_mesh("scene.glb", &bytes, 1 << 20);
    assert!(
        matches!(result, Err(Error::TooLarge { .. })),
        "{:?}",
        result.map(|m| m.vertices.len())
    );
}

#[test]
fn strips_and_fans_are_triangles() {
    // A square as a strip and as a fan, both counter-clockwise seen from above.
    for (mode, order) in [(5, [0u8, 1, 3, 2]), (6, [0, 1, 2, 3])] {
        let corners = [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let json = scene(r#"[{"mesh": 0}]"#, "", "")
            .replace(r#""indices": 1"#, &format!(r#""indices": 1, "mode": {mode}"#))
            .replace(r#""count": 8"#, r#""count": 4"#)
            .replace(r#""count": 36"#, r#""count": 4"#)
            .replace(r#""byteLength": 96"#, r#""byteLength": 48"#)
            .replace(
                r#""byteOffset": 96, "byteLength": 36"#,
                r#""byteOffset": 48, "byteLength": 4"#,
            )
            .replace("132", "52");
        let mut bytes: Vec<u8> =
            corners.iter().flat_map(|[x, y]| [*x, *y, 0.0]).flat_map(f32::to_le_bytes).collect();
        bytes.extend(order);
        let mesh = decode(&glb(&json, &bytes)).unwrap();
        assert_eq!(mesh.triangles.len(), 2);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|k| mesh.vertices[k as usize]);
            let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert_eq!(twice, 1.0, "mode {mode}");
        }
        assert!(matches!(mesh.to_region(), Err(inr_core::Error::OpenMesh { edges: 4 })));
    }
}

#[test]
fn cut_and_altered_files_never_panic() {
    let whole = glb(&scene(r#"[{"mesh": 0, "scale": [1, 2, 3]}]"#, "", ""), &box_bytes());
    for end in 0..whole.len() {
        let result = decode(&whole[..end]);
        assert!(matches!(result, Err(Error::Corrupt { .. } | Error::Empty { .. })), "{end}");
    }
    let mut next = random(9);
    for _ in 0..3000 {
        let mut altered = whole.clone();
        for _ in 0..1 + next() % 3 {
            let at = (next() % altered.len() as u64) as usize;
            altered[at] = match next() % 3 {
                0 => b"0123456789-,[]{}"[(next() % 16) as usize],
                1 => altered[at] ^ 1 << (next() % 8),
                _ => next() as u8,
            };
        }
        if let Ok(mesh) = decode_mesh("scene.glb", &altered, LIMIT) {
            let _ = mesh.to_region();
        }
    }
}
