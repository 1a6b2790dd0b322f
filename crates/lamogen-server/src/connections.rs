//! The open connections: how many there may be, and which of them makes room for another.
//!
//! A connection is idle while no request on it is being answered, and no answer waits to be read: before the head of its first request
//! has arrived, and between two requests. If no place is free, the connection that has been idle for the longest time is closed, as web servers do.

use std::collections::BTreeMap;
use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes, HttpBody};
use hyper::body::{Frame, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};

/// The time for which a connection may be idle in any case, so that a request that follows its connection can arrive.
const LEAST_IDLE: Duration = Duration::from_millis(250);
/// The time after which it is looked again for a connection that has been idle for so long.
const PAUSE: Duration = Duration::from_millis(20);

/// All open connections.
#[derive(Clone)]
pub(crate) struct Connections {
    places: Arc<Semaphore>,
    open: Arc<Mutex<BTreeMap<u64, Arc<Connection>>>>,
    opened: Arc<AtomicU64>,
}

/// The state of a connection.
struct Connection {
    usage: Mutex<Usage>,
    /// Says that the connection shall end if it is idle.
    end: Notify,
}

/// What a connection does.
struct Usage {
    /// The number of requests that are being answered.
    requests: usize,
    /// Whether a part of an answer waits until the client has read what was sent before.
    is_sending: bool,
    /// When the connection was last used, or began.
    since: Instant,
    /// Whether the connection has been told to end.
    is_ending: bool,
}

/// An open connection, which gives its place back when it is dropped.
pub(crate) struct OpenConnection {
    connections: Connections,
    index: u64,
    connection: Arc<Connection>,
    _place: OwnedSemaphorePermit,
}

/// A request that is being answered: until it is dropped, its connection is not idle.
pub(crate) struct RunningRequest(Arc<Connection>);

impl Connections {
    pub(crate) fn new(most: usize) -> Connections {
        Connections {
            places: Arc::new(Semaphore::new(most)),
            open: Arc::default(),
            opened: Arc::default(),
        }
    }

    /// Waits until there is a place for a further connection. If there is none, the connection that has been idle for the longest
    /// time is closed.
    pub(crate) async fn place(&self) -> OwnedSemaphorePermit {
        loop {
            if let Ok(place) = self.places.clone().try_acquire_owned() {
                return place;
            }
            self.end_longest_idle();
            let place = self.places.clone().acquire_owned();
            if let Ok(Ok(place)) = tokio::time::timeout(PAUSE, place).await {
                return place;
            }
        }
    }

    /// Registers a connection that has been accepted.
    pub(crate) fn open(&self, place: OwnedSemaphorePermit) -> OpenConnection {
        let index = self.opened.fetch_add(1, Ordering::Relaxed);
        let connection = Arc::new(Connection {
            usage: Mutex::new(Usage {
                requests: 0,
                is_sending: false,
                since: Instant::now(),
                is_ending: false,
            }),
            end: Notify::new(),
        });
        locked(&self.open).insert(index, connection.clone());
        OpenConnection {
            connections: self.clone(),
            index,
            connection,
            _place: place,
        }
    }

    /// Tells the connection that has been idle for the longest time to end.
    fn end_longest_idle(&self) {
        let open = locked(&self.open);
        let idle = open.values().filter_map(|connection| {
            let used = locked(&connection.usage);
            (used.is_idle() && !used.is_ending).then_some((used.since, connection))
        });
        if let Some((since, connection)) = idle.min_by_key(|(since, _)| *since)
            && since.elapsed() >= LEAST_IDLE
        {
            locked(&connection.usage).is_ending = true;
            connection.end.notify_one();
        }
    }
}

impl Usage {
    fn is_idle(&self) -> bool {
        self.requests == 0 && !self.is_sending
    }
}

impl OpenConnection {
    /// Returns the stream of the connection, which notes when an answer has to wait for its client.
    pub(crate) fn stream<T>(&self, stream: T) -> NotedStream<T> {
        NotedStream {
            stream,
            connection: self.connection.clone(),
        }
    }

    /// Returns the counter of the connection's requests.
    pub(crate) fn requests(&self) -> RequestCounter {
        RequestCounter(self.connection.clone())
    }

    /// Waits until the connection shall end because another one needs its place.
    pub(crate) async fn ended(&self) {
        loop {
            self.connection.end.notified().await;
            let mut used = locked(&self.connection.usage);
            if used.is_idle() {
                return;
            }
            // A request has come in the meantime.
            used.is_ending = false;
        }
    }
}

impl Drop for OpenConnection {
    fn drop(&mut self) {
        locked(&self.connections.open).remove(&self.index);
    }
}

/// Counts the requests of a connection.
#[derive(Clone)]
pub(crate) struct RequestCounter(Arc<Connection>);

impl RequestCounter {
    /// Notes that a request has arrived, until what is returned is dropped.
    pub(crate) fn begin(&self) -> RunningRequest {
        locked(&self.0.usage).requests += 1;
        RunningRequest(self.0.clone())
    }
}

impl Drop for RunningRequest {
    fn drop(&mut self) {
        let mut used = locked(&self.0.usage);
        used.requests -= 1;
        used.since = Instant::now();
    }
}

/// A stream that notes when what is written has to wait.
pub(crate) struct NotedStream<T> {
    stream: T,
    connection: Arc<Connection>,
}

impl<T: AsyncWrite + Unpin> NotedStream<T> {
    /// Notes whether a write has to wait.
    fn noted<R>(&self, written: Poll<R>) -> Poll<R> {
        let mut used = locked(&self.connection.usage);
        used.is_sending = written.is_pending();
        used.since = Instant::now();
        written
    }
}

impl<T: AsyncRead + Unpin> AsyncRead for NotedStream<T> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<T: AsyncWrite + Unpin> AsyncWrite for NotedStream<T> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.noted(written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        self.noted(written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

/// The body of an answer, with which its request ends.
pub(crate) struct AnswerBody {
    body: Body,
    _request: RunningRequest,
}

impl AnswerBody {
    pub(crate) fn new(body: Body, request: RunningRequest) -> AnswerBody {
        AnswerBody {
            body,
            _request: request,
        }
    }
}

impl HttpBody for AnswerBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// Locks what no panic leaves half changed.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
