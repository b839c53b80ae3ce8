//! Connections of the farm's users, as the gate counts them.

use std::sync::Arc;
use std::time::Duration;

use tokio::task::JoinHandle;
use tonic::{Request, Status};

use super::gate::{Connection, Gate};
use super::incoming::Peer;

/// Between two signs that a connection is in use.
const IN_USE_EVERY: Duration = Duration::from_secs(2);

/// What a service of users tells the gate.
#[derive(Clone, Debug)]
pub(crate) struct UserGate(Arc<Gate>);

/// A connection over which a user made a call.
pub(crate) struct UserConnection(Arc<Connection>);

/// While it lives, the connection is not taken for one that is of no use.
pub(crate) struct InUse(JoinHandle<()>);

impl Drop for InUse {
    fn drop(&mut self) {
        self.0.abort();
    }
}

impl UserGate {
    pub(super) fn new(gate: Arc<Gate>) -> Self {
        Self(gate)
    }

    /// A connection makes a call: it is one of a user.
    pub(crate) fn called<T>(&self, request: &Request<T>) -> Result<UserConnection, Status> {
        let peer = request.extensions().get::<Peer>();
        let connection = peer.ok_or_else(|| Status::internal("a call without a connection"))?.connection.clone();
        connection.beaten();
        self.0.settle(&connection);
        Ok(UserConnection(connection))
    }
}

impl UserConnection {
    /// Keeps it in use.
    pub(crate) fn in_use(self) -> InUse {
        InUse(tokio::spawn(async move {
            loop {
                self.0.beaten();
                tokio::time::sleep(IN_USE_EVERY).await;
            }
        }))
    }
}
