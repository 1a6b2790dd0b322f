//! The server: its connections, its end, and what its routes share.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::Router;
use futures_util::future::{Either, select};
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio_io_timeout::TimeoutStream;

use crate::config::{ServerConfig, ServerError};
use crate::connections::{AnswerBody, Connections};
use crate::job::JobLimits;
use crate::metrics::Metrics;
use crate::queue::WorkQueue;
use crate::routes::router;
use crate::service::MotionService;

/// An HTTP server for a [`MotionService`].
pub struct Server<S> {
    listener: std::net::TcpListener,
    address: SocketAddr,
    shared: Shared<S>,
    stop: watch::Sender<bool>,
}

/// What all requests share.
pub(crate) struct Shared<S> {
    pub(crate) service: Arc<S>,
    pub(crate) config: Arc<ServerConfig>,
    pub(crate) queue: WorkQueue,
    pub(crate) limits: JobLimits,
    pub(crate) metrics: Arc<Metrics>,
    /// The bytes of motion files that may still be held, in units of [`UPLOAD_UNIT`].
    pub(crate) uploads: Arc<Semaphore>,
}

/// The number of requests that are parsed at the same time.
const PARSING_THREADS: usize = 4;

/// The unit in which the bytes of motion files are counted.
pub(crate) const UPLOAD_UNIT: usize = 1 << 16;

impl<S> Clone for Shared<S> {
    fn clone(&self) -> Self {
        Shared {
            service: self.service.clone(),
            config: self.config.clone(),
            queue: self.queue.clone(),
            limits: self.limits.clone(),
            metrics: self.metrics.clone(),
            uploads: self.uploads.clone(),
        }
    }
}

/// Ends a [`Server`] from another thread.
#[derive(Clone, Debug)]
pub struct ServerHandle {
    stop: watch::Sender<bool>,
}

impl ServerHandle {
    /// Tells the server to end. It takes no more requests, refuses those that wait, and finishes those that run, if they
    /// do not take longer than the grace of its options.
    pub fn stop(&self) {
        self.stop.send_replace(true);
    }
}

impl<S: MotionService> Server<S> {
    /// Makes a server that listens on the address of its options. Requests wait until [`run`](Self::run) is called.
    ///
    /// # Errors
    ///
    /// If an option is not valid, the address cannot be listened on, or no threads can be started.
    pub fn bind(config: ServerConfig, service: S) -> Result<Server<S>, ServerError> {
        config.check()?;
        let address = config.address;
        let failed = |reason| ServerError::Bind { address, reason };
        let listener = std::net::TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let queue = WorkQueue::start(config.queue, config.workers)
            .map_err(|reason| ServerError::Threads { reason })?;
        let shared = Shared {
            service: Arc::new(service),
            queue,
            limits: JobLimits {
                time: config.work_time,
                is_shut_down: Arc::new(AtomicBool::new(false)),
            },
            metrics: Arc::default(),
            uploads: Arc::new(Semaphore::new(config.max_upload_total / UPLOAD_UNIT)),
            config: Arc::new(config),
        };
        Ok(Server {
            listener,
            address,
            shared,
            stop: watch::Sender::new(false),
        })
    }

    /// Returns the address that the server listens on, with its port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns a handle that ends the server.
    pub fn handle(&self) -> ServerHandle {
        let stop = self.stop.clone();
        ServerHandle { stop }
    }

    /// Answers requests until a [`ServerHandle`] ends the server.
    ///
    /// # Errors
    ///
    /// If the threads of the network cannot be started.
    pub fn run(self) -> Result<(), ServerError> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .max_blocking_threads(PARSING_THREADS)
            .enable_all()
            .build()
            .map_err(|reason| ServerError::Threads { reason })?;
        let (queue, grace) = (self.shared.queue.clone(), self.shared.config.grace);
        let is_shut_down = self.shared.limits.is_shut_down.clone();
        let result = runtime.block_on(self.serve());
        is_shut_down.store(true, Ordering::Relaxed);
        queue.wait_until_idle(grace);
        result
    }

    async fn serve(self) -> Result<(), ServerError> {
        let Server {
            listener,
            address,
            shared,
            stop,
        } = self;
        let listener = TcpListener::from_std(listener)
            .map_err(|reason| ServerError::Bind { address, reason })?;
        let (queue, limits, config) = (
            shared.queue.clone(),
            shared.limits.clone(),
            shared.config.clone(),
        );
        let connections = Connections::new(config.max_connections);
        let graceful = GracefulShutdown::new();
        let router: Router = router(shared);
        let mut http = http1::Builder::new();
        http.timer(TokioTimer::new())
            .header_read_timeout(config.head_time)
            .max_headers(64);
        let mut stopped = stop.subscribe();
        let accepting = async {
            loop {
                let stream = match listener.accept().await {
                    Ok((stream, _)) => stream,
                    Err(_) => {
                        // Too many open files, or a connection that is gone already.
                        tokio::time::sleep(Duration::from_millis(50)).await;
                        continue;
                    }
                };
                let open = connections.open(connections.place().await);
                // Small answers, such as events, must not wait for further ones.
                let _ = stream.set_nodelay(true);
                let mut stream = TimeoutStream::new(stream);
                stream.set_write_timeout(Some(config.write_time));
                let requests = open.requests();
                let router = TowerToHyperService::new(router.clone());
                let service = service_fn(move |request| {
                    let running = requests.begin();
                    let answer = router.call(request);
                    async {
                        Ok::<_, Infallible>(
                            answer.await?.map(|body| AnswerBody::new(body, running)),
                        )
                    }
                });
                let connection = graceful.watch(
                    http.serve_connection(TokioIo::new(open.stream(Box::pin(stream))), service),
                );
                tokio::spawn(async move {
                    // Connections that break are the clients' concern.
                    select(pin!(connection), pin!(open.ended())).await;
                });
            }
        };
        let told = async {
            let _ = stopped.wait_for(|is_stopped| *is_stopped).await;
        };
        match select(pin!(accepting), pin!(told)).await {
            Either::Left(_) | Either::Right(_) => {}
        }
        drop(listener);
        queue.close();
        let ended = graceful.shutdown();
        let mut ended = pin!(ended);
        if tokio::time::timeout(config.grace, ended.as_mut())
            .await
            .is_err()
        {
            limits.is_shut_down.store(true, Ordering::Relaxed);
            // A work looks at the flag after each of its steps.
            let _ = tokio::time::timeout(config.grace, ended).await;
        }
        Ok(())
    }
}
