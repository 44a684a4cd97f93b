//! What reaches the user: text on stdout, warnings on stderr.

use std::io::{self, Write};

use anyhow::{Context, Result};

/// Prints to stdout. A reader that has gone away (`| head`) is no error.
pub fn print(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
            Err(e).context("cannot print the result; check where the output goes")
        }
        _ => Ok(()),
    }
}

/// Prints warnings to stderr, one a line.
pub fn warn(warnings: &[String]) {
    complain("warning", warnings);
}

/// Prints an error to stderr.
pub fn error(message: &str) {
    complain("error", &[message.to_owned()]);
}

fn complain(kind: &str, messages: &[String]) {
    let mut err = io::stderr().lock();
    for message in messages {
        // When not even stderr works there is nobody left to tell.
        let _ = writeln!(err, "{kind}: {message}");
    }
}
