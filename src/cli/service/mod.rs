//! What answers a command: a running server, or this process on a database that no server has open. Either way it is the REST
//! interface that is asked, so that a command is written once.

/// Answers and refusals.
mod answer;
/// A running server.
mod server;
/// Tasks, and how far they are.
mod task;

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use axum::body::Body;
use bytes::Bytes;
use futures_util::Stream;
use http_body_util::combinators::UnsyncBoxBody;
use http_body_util::{BodyExt, Full, StreamBody};
use hyper::body::Frame;
use hyper::header::{CONTENT_ENCODING, CONTENT_TYPE};
use hyper::http::request::Builder;
use hyper::{Method, Request, Response};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::settings;
use crate::app::Inside;
use answer::Answer;
pub(super) use answer::Refusal;
use server::Server;
pub(super) use server::ServerArguments;
pub(super) use task::{Advance, Task};

/// Answers that say of the body that it is not taken, and nothing of who answers.
const OF_THE_BODY: [u16; 4] = [400, 413, 415, 422];

/// A body that is read while it is sent.
pub(super) struct FileBody<S> {
    pub(super) content_type: &'static str,
    pub(super) content_encoding: Option<&'static str>,
    pub(super) chunks: S,
}

/// What a command may do with a database that is opened for it alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Opened {
    /// It must be there.
    Known,
    /// It is made where it is not there.
    Made,
    /// It must be there, and tasks run.
    Learning,
}

/// What answers.
pub(super) enum Service {
    /// A server.
    Server(Box<Server>),
    /// This process.
    Inside(Box<Inside>),
}

impl Service {
    /// The server at `url`, which asks for no key.
    pub(super) fn at(url: &str) -> anyhow::Result<Self> {
        Ok(Self::Server(Box::new(Server::new(url, None, None)?)))
    }

    /// A database, with the settings that a server would find.
    pub(super) async fn inside(database: Option<&Path>, opened: Opened) -> anyhow::Result<Self> {
        let config = settings::of_a_server(database)?;
        let path = &config.database.path;
        if opened != Opened::Made && !path.exists() {
            bail!("there is no database {}; --database FILE names one, --server URL a server", path.display());
        }
        Ok(Self::Inside(Box::new(Inside::open(config, opened == Opened::Learning).await?)))
    }

    /// What becomes of a task when nobody waits for it any more.
    pub(super) fn goes_on(&self) -> &'static str {
        match self {
            Self::Server(_) => "the task goes on at the server",
            Self::Inside(_) => "the next `headway train`, or a server, goes on from the checkpoint that is written now",
        }
    }

    /// Ends what was opened for the command.
    pub(super) async fn close(self) {
        if let Self::Inside(inside) = self {
            inside.close().await;
        }
    }

    /// What is answered where it is done as asked.
    pub(super) async fn get<T: DeserializeOwned>(&self, path: &str) -> anyhow::Result<T> {
        self.send(Method::GET, path, None).await
    }

    /// As [`Self::get`].
    pub(super) async fn post<T: DeserializeOwned>(&self, path: &str, body: &Value) -> anyhow::Result<T> {
        self.send(Method::POST, path, Some(body)).await
    }

    /// As [`Self::get`].
    pub(super) async fn send<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: Option<&Value>,
    ) -> anyhow::Result<T> {
        let mut request = self.request(method, path);
        if body.is_some() {
            request = request.header(CONTENT_TYPE, "application/json");
        }
        let body = body.map_or_else(Bytes::new, |body| body.to_string().into());
        let answer = self.answer(request, whole(body)).await?;
        if answer.is_success { answer.read(path) } else { Err(self.refusal(&answer)) }
    }

    /// Every entry of a list, page by page.
    pub(super) async fn list(&self, path: &str, member: &str) -> anyhow::Result<Vec<Value>> {
        let (mut listed, mut token) = (Vec::new(), String::new());
        loop {
            let mut page: Value = self.get(&format!("{path}?page_size=1000{token}")).await?;
            let entries = page[member].as_array_mut().with_context(|| format!("{path} answered without {member}"))?;
            listed.append(entries);
            match page["next_page_token"].as_str() {
                Some(next) => token = format!("&page_token={next}"),
                None => return Ok(listed),
            }
        }
    }

    /// Posts a body, and gives whether it was taken, and what is answered; a refusal of what the body holds is an answer too.
    pub(super) async fn upload<S>(&self, path: &str, body: FileBody<S>) -> anyhow::Result<(bool, Value)>
    where
        S: Stream<Item = io::Result<Frame<Bytes>>> + Send + 'static,
    {
        let mut request = self.request(Method::POST, path).header(CONTENT_TYPE, body.content_type);
        if let Some(encoding) = body.content_encoding {
            request = request.header(CONTENT_ENCODING, encoding);
        }
        let answer = self.answer(request, StreamBody::new(body.chunks).boxed_unsync()).await?;
        let of_the_body = OF_THE_BODY.contains(&answer.status) && answer.body["code"].is_string();
        if answer.is_success || of_the_body { Ok((answer.is_success, answer.body)) } else { Err(self.refusal(&answer)) }
    }

    /// Writes what is handed out, piece by piece.
    pub(super) async fn download(&self, path: &str, file: &mut File) -> anyhow::Result<()> {
        let mut body = self.stream(path).await?;
        while let Some(frame) = body.frame().await {
            if let Some(bytes) = frame.context("the server broke off")?.data_ref() {
                file.write_all(bytes)?;
            }
        }
        Ok(())
    }

    /// The task at `path` once it has ended; `shown` is told of its progress on the way.
    pub(super) async fn follow(&self, path: &str, shown: impl FnMut(&Advance)) -> anyhow::Result<Task> {
        task::follow(self, path, shown).await
    }

    async fn stream(&self, path: &str) -> anyhow::Result<Body> {
        let response = self.exchange(self.request(Method::GET, path), whole(Bytes::new())).await?;
        if response.status().is_success() {
            return Ok(response.into_body());
        }
        Err(self.refusal(&Answer::of(response).await?))
    }

    fn request(&self, method: Method, path: &str) -> Builder {
        let request = Request::builder().method(method);
        match self {
            Self::Server(server) => server.address(request, path),
            Self::Inside(_) => request.uri(path),
        }
    }

    async fn answer(&self, request: Builder, body: UnsyncBoxBody<Bytes, io::Error>) -> anyhow::Result<Answer> {
        Answer::of(self.exchange(request, body).await?).await
    }

    async fn exchange(
        &self,
        request: Builder,
        body: UnsyncBoxBody<Bytes, io::Error>,
    ) -> anyhow::Result<Response<Body>> {
        match self {
            Self::Server(server) => server.exchange(request.body(body).context("--server is no URL")?).await,
            Self::Inside(inside) => Ok(inside.answer(request.body(body)?).await),
        }
    }

    fn refusal(&self, answer: &Answer) -> anyhow::Error {
        match self {
            Self::Server(_) => anyhow!(answer.refusal()).context(format!("the server answered {}", answer.shown)),
            Self::Inside(_) => answer.refusal().into(),
        }
    }
}

fn whole(body: Bytes) -> UnsyncBoxBody<Bytes, io::Error> {
    Full::new(body).map_err(|never| match never {}).boxed_unsync()
}
