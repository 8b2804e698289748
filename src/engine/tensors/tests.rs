use super::*;

fn sample() -> Vec<u8> {
    let mut encoder = Encoder::default();
    encoder.array("small", &[3], &[1u8, 2, 3]);
    encoder.array("matrix", &[2, 2], &[1.0, -2.5, 3.0, 1e-300]);
    encoder.owned("index", &[1], vec![7u32]);
    encoder.texts("names", &["a".to_owned(), "ü".to_owned()]);
    encoder.finish()
}

#[test]
fn what_is_written_is_read() {
    let bytes = sample();
    let decoder = Decoder::new(&bytes).unwrap();
    let (n_rows, n_cols, values) = decoder.matrix::<f64>("matrix").unwrap();
    assert_eq!((n_rows, n_cols, &values[..]), (2, 2, &[1.0, -2.5, 3.0, 1e-300][..]));
    assert_eq!(&decoder.vector::<u8>("small").unwrap()[..], [1, 2, 3]);
    assert_eq!(&decoder.vector::<u32>("index").unwrap()[..], [7]);
    assert_eq!(decoder.texts("names").unwrap(), ["a", "ü"]);
    assert!(decoder.vector::<f32>("index").is_err());
    assert!(decoder.vector::<f64>("matrix").is_err());
}

/// A file as another program might write it.
fn foreign(dtype: &str, shape: usize, bytes: &[u8]) -> Vec<u8> {
    let entry = serde_json::json!({
        "x": { "dtype": dtype, "shape": [shape], "data_offsets": [0, bytes.len()] },
    });
    let header = entry.to_string().into_bytes();
    [&(header.len() as u64).to_le_bytes(), &header[..], bytes].concat()
}

#[test]
fn foreign_numbers_are_taken_where_no_value_changes() {
    let read = |dtype, bytes: &[u8]| {
        let file = foreign(dtype, 1, bytes);
        let decoder = Decoder::foreign(&file)?;
        Ok(decoder.vector::<u32>("x")?[0])
    };
    assert_eq!(read("I64", &7i64.to_le_bytes()), Ok(7));
    assert_eq!(read("I32", &7i32.to_le_bytes()), Ok(7));
    assert_eq!(read("BOOL", &[1]), Ok(1));
    assert_eq!(read("F32", &7f32.to_le_bytes()), Ok(7));
    let message = |it: Result<u32, DecodeError>| it.unwrap_err().0;
    let refused = message(read("I64", &(-1i64).to_le_bytes()));
    assert_eq!(refused, "array `x` holds -1, which is no U32");
    let refused = message(read("F64", &0.5f64.to_le_bytes()));
    assert_eq!(refused, "array `x` holds 0.5, which is no U32");
    assert!(message(read("C64", &[0; 8])).contains("the entry of array `x`"));
    let ours = foreign("I64", 1, &7i64.to_le_bytes());
    assert!(Decoder::new(&ours).unwrap().vector::<u32>("x").is_err(), "artifacts are exact");
}

#[test]
fn a_foreign_header_may_list_the_arrays_in_any_order() {
    let header = br#"{"b":{"dtype":"U8","shape":[1],"data_offsets":[1,2]},"a":{"dtype":"U8","shape":[1],"data_offsets":[0,1]}}"#;
    let file = [&(header.len() as u64).to_le_bytes(), &header[..], &[5, 6]].concat();
    let decoder = Decoder::foreign(&file).unwrap();
    assert_eq!(decoder.vector::<u8>("a").unwrap()[0], 5);
    assert_eq!(decoder.vector::<u8>("b").unwrap()[0], 6);
    assert!(Decoder::new(&file).is_err());
}

#[test]
fn every_truncation_and_every_flipped_length_is_refused() {
    let bytes = sample();
    for length in 0..bytes.len() {
        assert!(Decoder::new(&bytes[..length]).is_err(), "{length} bytes");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(Decoder::new(&longer).is_err());
    let mut huge = bytes;
    huge[7] = 0xff;
    assert!(Decoder::new(&huge).is_err());
}
