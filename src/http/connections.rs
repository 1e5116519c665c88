//! Connections: taken in, answered one request after another, and let go when the server stops.

use std::convert::Infallible;
use std::io::{Error, ErrorKind};
use std::sync::Arc;
use std::time::Duration;

use axum::http::Response;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::timeout;

use super::interface::Interface;
use super::patience::{Activity, Patience, Watched};
use super::tls::Tls;
use super::{ServerSettings, stopped};

/// How long no connection is taken in after the system could not give one: it has no more of something, and asking again at
/// once would only take its time.
const PAUSE: Duration = Duration::from_secs(1);

/// What a client is told when as many connections are open as the server keeps.
const FULL: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: application/problem+json\r\nretry-after: 1\r\n\
    connection: close\r\ncontent-length: 162\r\n\r\n\
    {\"type\":\"/problems/busy\",\"title\":\"Too many requests of this kind at once\",\"status\":503,\
    \"code\":\"busy\",\"detail\":\"as many connections are open as the server keeps\"}\n";

/// Answers whoever connects to `listener`, `settings.connections` of them at once. Once `stopping` turns true nobody else is
/// taken in, connections between two requests are closed, and the others after the answer they wait for; then this ends.
pub async fn serve(
    listener: TcpListener,
    tls: Option<Arc<Tls>>,
    interface: Interface,
    settings: &ServerSettings,
    mut stopping: watch::Receiver<bool>,
) {
    let connections = GracefulShutdown::new();
    let (free, telling) =
        (Arc::new(Semaphore::new(settings.connections)), Arc::new(Semaphore::new(settings.refused_at_once)));
    let hearing = Duration::from_secs_f64(settings.refusal_s);
    let patience = Patience::new(settings);
    let mut http = http1::Builder::new();
    http.max_buf_size(settings.head_bytes);
    loop {
        tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => match Arc::clone(&free).try_acquire_owned() {
                    Ok(place) => {
                        let answering = Answering { http: http.clone(), interface: interface.clone(), patience };
                        tokio::spawn(receive(stream, tls.clone(), answering, connections.watcher(), place));
                    }
                    // Who expects to be spoken to under encryption understands nothing else.
                    Err(_) if tls.is_some() => {}
                    Err(_) => {
                        if let Ok(place) = Arc::clone(&telling).try_acquire_owned() {
                            tokio::spawn(tell_full(stream, hearing, place));
                        }
                    }
                },
                Err(error) if of_the_client(&error) => {}
                Err(error) => {
                    tracing::error!(%error, "no connection can be taken in");
                    tokio::time::sleep(PAUSE).await;
                }
            },
            () = stopped(&mut stopping) => break,
        }
    }
    drop(listener);
    connections.shutdown().await;
}

/// Whether it only says that a client was gone before it was taken in.
fn of_the_client(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset)
}

/// Says that the server is full, and waits until the client has heard it: closing at once would tear up what is on its way.
async fn tell_full(mut stream: TcpStream, hearing: Duration, _place: OwnedSemaphorePermit) {
    let told = async {
        stream.write_all(FULL).await?;
        stream.shutdown().await?;
        let mut rest = [0; 1024];
        while stream.read(&mut rest).await? > 0 {}
        Ok::<_, Error>(())
    };
    let _ = timeout(hearing, told).await;
}

/// What a connection is answered with.
struct Answering {
    http: http1::Builder,
    interface: Interface,
    patience: Patience,
}

/// Takes one connection in, encrypted or not.
async fn receive(
    stream: TcpStream,
    tls: Option<Arc<Tls>>,
    answering: Answering,
    stop: Watcher,
    _place: OwnedSemaphorePermit,
) {
    // An answer is written at once and whole; waiting for more to send with it only delays it.
    let _ = stream.set_nodelay(true);
    let Some(tls) = tls else { return answer(stream, answering, stop).await };
    match tls.accept(stream).await {
        Ok(stream) => answer(stream, answering, stop).await,
        Err(error) => tracing::debug!(%error, "no keys were agreed on"),
    }
}

/// Answers the requests of one connection.
async fn answer(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    Answering { http, interface, patience }: Answering,
    stop: Watcher,
) {
    // Counted by this connection alone: threads that share a count for every request wait for each other.
    let own = Arc::new((interface, Arc::new(Activity::default())));
    let activity = Arc::clone(&own.1);
    let service = service_fn(move |request| {
        let own = Arc::clone(&own);
        async move {
            let (interface, activity) = &*own;
            activity.asked();
            let answer = interface.answer(request).await;
            activity.answered();
            Ok::<Response<_>, Infallible>(answer)
        }
    });
    let stream = TokioIo::new(Watched::new(stream, Arc::clone(&activity)));
    let connection = http.serve_connection(stream, service);
    tokio::select! {
        ended = stop.watch(connection) => if let Err(error) = ended {
            tracing::trace!(%error, "a connection broke");
        },
        () = patience.ends(&activity) => {}
    }
}
