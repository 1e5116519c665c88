use std::io::{Read, Write};
use std::net::TcpStream;

use serde_json::Value;

use crate::process::{Process, Reply};

/// A request on a connection of its own.
pub(crate) struct Wire {
    stream: TcpStream,
}

/// An answer that came in whole.
pub(crate) type Answer = Reply;

impl Wire {
    /// Begins an upload. The server asks for the body, so what is killed from here on reads it.
    pub(crate) fn upload(process: &Process, path: &str, key: &str) -> Self {
        let fields = "content-type: application/x-ndjson\r\ntransfer-encoding: chunked\r\nexpect: 100-continue\r\n";
        let mut wire = Self::begin(process, path, key, fields);
        let (mut told, mut byte) = (Vec::new(), [0]);
        while !told.ends_with(b"\r\n\r\n") {
            wire.stream.read_exact(&mut byte).unwrap();
            told.push(byte[0]);
        }
        assert!(told.starts_with(b"HTTP/1.1 100 "), "{}", String::from_utf8_lossy(&told));
        wire
    }

    /// A whole request with a JSON body.
    pub(crate) fn post(process: &Process, path: &str, key: &str, body: &Value) -> Self {
        let body = body.to_string();
        let fields = format!("content-type: application/json\r\ncontent-length: {}\r\n", body.len());
        let mut wire = Self::begin(process, path, key, &fields);
        wire.stream.write_all(body.as_bytes()).unwrap();
        wire
    }

    fn begin(process: &Process, path: &str, key: &str, fields: &str) -> Self {
        let address = process.url.trim_start_matches("http://");
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        let head = format!(
            "POST {path} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\nidempotency-key: {key}\r\n{fields}\r\n"
        );
        stream.write_all(head.as_bytes()).unwrap();
        Self { stream }
    }

    /// The next part of the body.
    pub(crate) fn chunk(&mut self, bytes: &[u8]) {
        let mut framed = format!("{:x}\r\n", bytes.len()).into_bytes();
        framed.extend(bytes);
        framed.extend(b"\r\n");
        self.stream.write_all(&framed).unwrap();
    }

    /// The end of the body.
    pub(crate) fn finish(&mut self) {
        self.stream.write_all(b"0\r\n\r\n").unwrap();
    }

    /// The answer; none when the connection ended before it was whole.
    pub(crate) fn answer(mut self) -> Option<Answer> {
        let mut bytes = Vec::new();
        // A killed process resets the connection; what came before that counts.
        let _ = self.stream.read_to_end(&mut bytes);
        let text = String::from_utf8(bytes).unwrap();
        let (head, body) = text.split_once("\r\n\r\n")?;
        let mut lines = head.lines();
        let status = lines.next()?.split(' ').nth(1)?.parse().unwrap();
        let length = lines.find_map(|line| line.strip_prefix("content-length: ")).expect("a length is declared");
        (body.len() == length.parse::<usize>().unwrap()).then(|| Answer { status, text: body.to_owned() })
    }
}
