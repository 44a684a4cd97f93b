//! Addresses of buffers: data inside of the text, or the name of a file beside it.

use crate::error::Fault;

/// What an address leads to.
#[derive(Debug, PartialEq)]
pub(super) enum Source {
    Inside(Vec<u8>),
    Beside(String),
}

/// Reads an address. Files must stand in the same folder: a scene from elsewhere must not reach others.
pub(super) fn resolve(uri: &str) -> Result<Source, Fault> {
    if let Some(rest) = uri.strip_prefix("data:") {
        let text = rest.split_once(";base64,").map(|(_, text)| text);
        let text = text.ok_or_else(|| Fault::Feature("data that is not base64".to_owned()))?;
        return from_base64(text).map(Source::Inside);
    }
    let name = from_percent(uri)?;
    match name.is_empty() || name == ".." || name.contains(['/', '\\', ':', '\0']) {
        true => {
            let shown: String = name.chars().take(80).collect();
            Err(Fault::Feature(format!("the buffer {shown:?}, which is no file in its folder")))
        }
        false => Ok(Source::Beside(name)),
    }
}

fn from_percent(text: &str) -> Result<String, Fault> {
    let bad = || Fault::corrupt("the address of a buffer is not text");
    let mut parts = text.split('%');
    let mut out = parts.next().unwrap_or_default().as_bytes().to_vec();
    for part in parts {
        let (code, rest) = part.split_at_checked(2).ok_or_else(bad)?;
        out.push(u8::from_str_radix(code, 16).map_err(|_| bad())?);
        out.extend(rest.as_bytes());
    }
    String::from_utf8(out).map_err(|_| bad())
}

/// The alphabet of RFC 4648, section 4; padding may be missing.
fn from_base64(text: &str) -> Result<Vec<u8>, Fault> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut count) = (0u32, 0);
    for byte in text.trim_end_matches('=').bytes() {
        let digit = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return Err(Fault::corrupt("its data are not base64")),
        };
        bits = bits << 6 | u32::from(digit);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_the_standard() {
        // RFC 4648, section 10.
        for (text, plain) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmE=", "fooba")]
        {
            assert_eq!(from_base64(text).unwrap(), plain.as_bytes());
        }
        assert!(from_base64("Zm9*").is_err());
    }

    #[test]
    fn only_files_beside() {
        assert_eq!(resolve("my%20box.bin").unwrap(), Source::Beside("my box.bin".to_owned()));
        for bad in
            ["../a.bin", "/etc/passwd", "a%2Fb", "http://x.y", "", "..", "a%0", "a%zz", "%ff"]
        {
            assert!(resolve(bad).is_err(), "{bad}");
        }
    }
}
