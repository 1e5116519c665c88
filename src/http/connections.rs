//! Connections: taken in, answered one request after another, and let go when the server stops.

use std::convert::Infallible;
use std::io::{Error, ErrorKind};
use std::sync::Arc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

use super::interface::Interface;
use super::stopped;
use super::tls::Tls;

/// How long no connection is taken in after the system could not give one: it has no more of something, and asking again at
/// once would only take its time.
const PAUSE: Duration = Duration::from_secs(1);

/// Answers whoever connects to `listener`. Once `stopping` turns true nobody else is taken in, connections between two
/// requests are closed, and the others after the answer they wait for; then this ends.
pub async fn serve(
    listener: TcpListener,
    tls: Option<Arc<Tls>>,
    interface: Interface,
    mut stopping: watch::Receiver<bool>,
) {
    let connections = GracefulShutdown::new();
    loop {
        tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => {
                    tokio::spawn(receive(stream, tls.clone(), interface.clone(), connections.watcher()));
                }
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

/// Takes one connection in, encrypted or not.
async fn receive(stream: TcpStream, tls: Option<Arc<Tls>>, interface: Interface, stop: Watcher) {
    // An answer is written at once and whole; waiting for more to send with it only delays it.
    let _ = stream.set_nodelay(true);
    let Some(tls) = tls else { return answer(stream, interface, stop).await };
    match tls.accept(stream).await {
        Ok(stream) => answer(stream, interface, stop).await,
        Err(error) => tracing::debug!(%error, "no keys were agreed on"),
    }
}

/// Answers the requests of one connection.
async fn answer(stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static, interface: Interface, stop: Watcher) {
    // Counted by this connection alone: threads that share a count for every request wait for each other.
    let interface = Arc::new(interface);
    let service = service_fn(move |request| {
        let interface = Arc::clone(&interface);
        async move { Ok::<_, Infallible>(interface.answer(request).await) }
    });
    let connection = http1::Builder::new().serve_connection(TokioIo::new(stream), service);
    if let Err(error) = stop.watch(connection).await {
        tracing::trace!(%error, "a connection broke");
    }
}
