//! Files that are not what they should be.

use super::*;

/// The same file with another header; numbers stay.
fn with_header(bytes: &[u8], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let (length, rest) = bytes.split_first_chunk().unwrap();
    let (header, data) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let mut header = serde_json::from_slice(header).unwrap();
    change(&mut header);
    let header = header.to_string();
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

/// The same file with another text in its metadata.
fn with_text(bytes: &[u8], key: &str, text: &str) -> Vec<u8> {
    with_header(bytes, |h| h["__metadata__"][key] = json!(text))
}

/// The same file with another name for one tensor.
fn renamed(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    with_header(bytes, |h| {
        let header = h.as_object_mut().unwrap();
        let info = header.remove(from).unwrap();
        header.insert(to.into(), info);
    })
}

fn siren() -> Vec<u8> {
    checkpoint::<2, 3>(Architecture::siren(5, 2, 3.0)).to_bytes().unwrap()
}

fn read(bytes: &[u8]) -> Result<()> {
    Checkpoint::<2, 3>::from_bytes(bytes).map(|_| ())
}

#[test]
fn other_files_say_what_they_are() {
    let bytes = siren();
    for cut in [0, 7, 8, 100, bytes.len() - 1] {
        assert!(matches!(read(&bytes[..cut]), Err(Error::NotSafetensors { .. })), "{cut}");
    }
    assert!(matches!(read(&[&bytes[..], &[0]].concat()), Err(Error::NotSafetensors { .. })));
    assert!(matches!(read(b"\x89PNG\r\n\x1a\n and so on"), Err(Error::NotSafetensors { .. })));
    let foreign = with_header(&bytes, |h| h["__metadata__"] = json!({"format": "pt"}));
    assert!(matches!(read(&foreign), Err(Error::ForeignTensors { .. })));
    let bare = with_header(&bytes, |h| drop(h.as_object_mut().unwrap().remove("__metadata__")));
    assert!(matches!(read(&bare), Err(Error::ForeignTensors { .. })));
    // Whatever a newer version says otherwise.
    let newer = with_text(&with_text(&bytes, "version", "2"), "architecture", "?");
    assert_eq!(read(&newer), Err(Error::CheckpointVersion { found: 2, supported: 1 }));
    let other = Checkpoint::<3, 1>::from_bytes(&bytes).map(|_| ());
    assert_eq!(other, Err(Error::Dimensions { expected: [3, 1], found: [2, 3] }));
}

#[test]
fn damaged_metadata_name_their_entry() {
    let bytes = siren();
    let domain = r#"{"shape":[6,7],"pitch":[1],"origin":[0,0],"unit":"sample"}"#;
    let frame = r#"{"center":[0,0,0],"half":[1,1,1]}"#;
    for (key, text) in [
        ("version", "one"),
        ("version", "0"),
        ("architecture", "{}"),
        ("domain", domain),
        ("frame", frame),
        ("output", r#"{"offset":[0,0,0],"scale":[1,1]}"#),
        ("range", "[0]"),
        ("range", "[0, 1e300]"),
        ("notes", "[]"),
        ("training", "{"),
    ] {
        match read(&with_text(&bytes, key, text)) {
            Err(Error::CheckpointEntry { entry, .. }) => assert_eq!(entry, key),
            other => panic!("{key} = {text}: {other:?}"),
        }
    }
    let no_domain = with_header(&bytes, |h| {
        h["__metadata__"].as_object_mut().unwrap().remove("domain");
    });
    assert!(matches!(read(&no_domain), Err(Error::CheckpointEntry { .. })));
    for (key, text) in [("range", "[1, 0]"), ("frame", r#"{"center":[0,0],"half":[1,0]}"#)] {
        let found = read(&with_text(&bytes, key, text));
        assert!(matches!(found, Err(Error::Parameter { .. })), "{key} = {text}: {found:?}");
    }
    let pitch = with_text(&bytes, "domain", &domain.replace("[1]", "[1,-1]"));
    assert_eq!(read(&pitch), Err(Error::Pitch { axis: 1, value: -1.0 }));
    assert_eq!(Description::from_bytes(&pitch), Err(Error::Pitch { axis: 1, value: -1.0 }));
}

#[test]
fn wrong_tensors_are_named() {
    let (bytes, name) = (siren(), "mlp.1.weight".to_string());
    let missing = renamed(&bytes, &name, "w");
    assert_eq!(read(&missing), Err(Error::TensorMissing { name: name.clone() }));
    let moment = "adam.second_moment.mlp.0.bias";
    let missing = renamed(&bytes, moment, "m");
    assert_eq!(read(&missing), Err(Error::TensorMissing { name: moment.into() }));
    let shape = with_header(&bytes, |h| h["mlp.1.weight"]["shape"] = json!([25]));
    let (expected, found) = (vec![5, 5], vec![25]);
    assert_eq!(read(&shape), Err(Error::TensorShape { name: name.clone(), expected, found }));
    let integers = with_header(&bytes, |h| h["mlp.1.weight"]["dtype"] = json!("I32"));
    let found = "I32".to_string();
    assert_eq!(read(&integers), Err(Error::TensorType { name: name.clone(), found }));
    // One hidden layer instead of two: the rest of the tensors would fit.
    let architecture = r#"{"encoding":{"kind":"identity"},
        "mlp":{"width":5,"depth":1,"activation":{"kind":"relu"},"skip":null}}"#;
    let shallow = with_text(&bytes, "architecture", architecture);
    assert!(matches!(read(&shallow), Err(Error::TensorUnexpected { .. })));
    // Tensors of other people do no harm.
    let more = with_header(&bytes, |h| {
        let end = bytes.len() - 8 - u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        h["mean_colour"] = json!({"dtype": "F32", "shape": [2, 0], "data_offsets": [end, end]});
    });
    assert_eq!(read(&more), Ok(()));
}

#[test]
fn numbers_that_are_not_finite_are_neither_read_nor_written() {
    let mut diverged = checkpoint::<2, 3>(Architecture::siren(5, 2, 3.0));
    diverged.network.params_mut()[0] = f32::NAN;
    let rule = "finite";
    let refused = Err(Error::TensorValues { name: "mlp.0.weight".into(), rule });
    assert_eq!(diverged.to_bytes(), refused);
    let mut bytes = siren();
    let last = bytes.len() - 4;
    bytes[last..].copy_from_slice(&f32::INFINITY.to_le_bytes());
    let name = "adam.second_moment.mlp.output.bias".into();
    assert_eq!(read(&bytes), Err(Error::TensorValues { name, rule }));
    for range in [[f32::NAN, 1.0], [0.0, f32::INFINITY]] {
        let c = checkpoint::<2, 3>(Architecture::siren(5, 2, 3.0));
        let written = Checkpoint { range, ..c }.to_bytes();
        assert!(matches!(written, Err(Error::Parameter { .. })), "{written:?}");
    }
    let mut short = checkpoint::<2, 3>(Architecture::siren(5, 2, 3.0));
    let expected = short.network.params().len();
    short.training.as_mut().unwrap().first_moment.pop();
    assert_eq!(short.to_bytes(), Err(Error::Length { expected, found: expected - 1 }));
}

#[test]
fn frequencies_of_another_seed_are_an_error() {
    let architecture = Architecture::fourier(11, 0.7, 16, 2);
    let bytes = checkpoint::<2, 3>(architecture).to_bytes().unwrap();
    let other = with_header(&bytes, |h| {
        let text = h["__metadata__"]["architecture"].as_str().unwrap();
        h["__metadata__"]["architecture"] = json!(text.replace("\"seed\":0", "\"seed\":1"));
    });
    let name = "encoding.frequencies".into();
    let rule = "those of the architecture";
    assert_eq!(read(&other), Err(Error::TensorValues { name, rule }));
}

/// 2^33 rows: 32 GB, were they believed.
#[test]
fn sizes_are_compared_with_the_file_before_memory_is_taken() {
    let mut architecture = Architecture::grid(&[6, 7], 1 << 6);
    let bytes = checkpoint::<2, 3>(architecture.clone()).to_bytes().unwrap();
    let mut with_rows = |features: usize, nodes: [usize; 2], rows: usize| {
        let Encoding::Grid(grid) = &mut architecture.encoding else { unreachable!() };
        (grid.features, grid.levels) = (features, vec![Level { nodes: nodes.to_vec(), rows }]);
        let text = serde_json::to_string(&architecture).unwrap();
        read(&with_text(&bytes, "architecture", &text))
    };
    let huge = with_rows(1, [1 << 17, 1 << 16], 1 << 33);
    assert!(matches!(huge, Err(Error::TensorShape { .. })), "{huge:?}");
    let beyond = with_rows(1, [1 << 20, 1 << 20], 1 << 40);
    assert!(matches!(beyond, Err(Error::Parameter { .. })), "{beyond:?}");
    let most = with_rows(8, [1 << 24, 1 << 24], usize::MAX);
    assert!(matches!(most, Err(Error::Parameter { .. })), "{most:?}");
    let wide = Architecture::siren(1 << 14, 1 << 10, 1.0);
    let wide = with_text(&bytes, "architecture", &serde_json::to_string(&wide).unwrap());
    assert!(matches!(read(&wide), Err(Error::TensorShape { .. } | Error::TensorMissing { .. })));
}

/// Reads a damaged file; if it still is one, the network has to work.
fn read_and_use(bytes: &[u8]) {
    let _ = Description::from_bytes(bytes);
    let (frame, output) = (Frame { center: [0.0; 2], half: [1.0; 2] }, Output::of_range(0.0, 1.0));
    let nearest = Interpolation::Nearest;
    let networks = [
        Checkpoint::<2, 3>::from_bytes(bytes).map(|c| c.network),
        import_siren(bytes, &[30.0], AxisOrder::LastAxisFirst, frame, output),
        import_diner(bytes, imports::SHAPE, nearest, &[30.0], frame, output),
    ];
    for network in networks.into_iter().flatten() {
        let mut y = [[0.0; 3]; 4];
        network.eval(&[[0.0; 2], [1.0, 2.0], [-1e9, 1e9], [f32::NAN; 2]], &mut y);
        assert!(network.params().iter().all(|p| p.is_finite()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// Bytes changed, above all digits of the header, so that it still parses.
    #[test]
    fn damaged_bytes_never_panic(
        kind in 0usize..9,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0u8..4), 1..5),
        cut in prop::option::weighted(0.1, any::<prop::sample::Index>()),
    ) {
        let mut bytes = file(kind);
        let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        for (index, byte, how) in changes {
            let digits: Vec<usize> = (8..header).filter(|i| bytes[*i].is_ascii_digit()).collect();
            match how {
                0 => { let i = index.index(bytes.len()); bytes[i] = byte }
                1 => { let i = index.index(header); bytes[i] = byte }
                _ => { let i = digits[index.index(digits.len())]; bytes[i] = b'0' + byte % 10 }
            }
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        read_and_use(&bytes);
    }

    #[test]
    fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        read_and_use(&bytes);
    }
}

/// A file of each kind, made once: seven of ours, two of others.
fn file(kind: usize) -> Vec<u8> {
    static FILES: std::sync::OnceLock<Vec<Vec<u8>>> = std::sync::OnceLock::new();
    let all = || {
        let ours = architectures::<2>().into_iter().map(|(_, a)| checkpoint::<2, 3>(a));
        let ours = ours.map(|c| c.to_bytes().unwrap());
        ours.chain([imports::siren_file(), imports::diner_file()]).collect()
    };
    FILES.get_or_init(all)[kind].clone()
}
