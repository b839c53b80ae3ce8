//! A worker that says whatever it is told to.

use std::net::SocketAddr;
use std::time::Duration;

use tessera_proto::convert::Registration;
use tessera_proto::identity::Identity;
use tessera_proto::wire::coordinator_message::Kind as Hear;
use tessera_proto::wire::farm_client::FarmClient;
use tessera_proto::wire::worker_message::Kind as Say;
use tessera_proto::wire::{
    BeatRequest, CoordinatorMessage, GreetRequest, Lease, RayCounts, Ready, Register, TileDone, Welcome, WorkerMessage,
};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint};
use tonic::{Status, Streaming};

/// Longer than anything here takes.
const NEVER: Duration = Duration::from_secs(60);

/// A session without a worker behind it. It beats as long as it lives.
#[derive(Debug)]
pub struct Fake {
    out: mpsc::Sender<WorkerMessage>,
    inbox: Streaming<CoordinatorMessage>,
    /// Another client of the same connection.
    pub client: FarmClient<Channel>,
    /// What it was welcomed with.
    pub welcome: Welcome,
    heart: tokio::task::JoinHandle<()>,
}

/// What an honest worker of that name would register with.
#[must_use]
pub fn registration(name: &str) -> Register {
    registration_by(&identity(name), name)
}

/// The key of the fake worker of that name.
///
/// # Panics
/// Never.
#[must_use]
pub fn identity(name: &str) -> Identity {
    let mut seed = [0; 32];
    for (at, byte) in name.bytes().enumerate() {
        seed[at % 32] ^= byte;
    }
    Identity::from_seed(&seed).expect("every seed makes a key")
}

/// A registration without proof, which is put in when the connection is there.
#[must_use]
pub fn registration_by(identity: &Identity, name: &str) -> Register {
    Registration { name: name.into(), threads: 1, id: identity.id(), proof: Vec::new(), local: None }.into()
}

/// An answer to `lease` of `bytes` black bytes.
#[must_use]
pub fn done(lease: &Lease, bytes: usize) -> Say {
    Say::TileDone(TileDone {
        lease: lease.lease,
        attempt: lease.attempt,
        pixels: vec![0; bytes].into(),
        packed: 0,
        rays: Some(RayCounts::default()),
        busy_us: 1000,
        idle_us: 0,
        error: None,
    })
}

/// Bytes of `lease` in floats.
///
/// # Panics
/// When it has no region.
#[must_use]
pub fn float_bytes(lease: &Lease) -> usize {
    let r = lease.region.expect("a lease has a region");
    12 * ((r.x1 - r.x0) * (r.y1 - r.y0)) as usize
}

impl Fake {
    /// Registers so.
    ///
    /// # Errors
    /// When it is refused.
    ///
    /// # Panics
    /// When there is no coordinator.
    pub async fn register(addr: SocketAddr, register: Register) -> Result<Self, Status> {
        Self::first_words(addr, Some(Say::Register(register))).await
    }

    /// Opens a session with these words; `None` is a message that says nothing.
    ///
    /// # Errors
    /// When it is refused.
    ///
    /// # Panics
    /// When there is no coordinator.
    pub async fn first_words(addr: SocketAddr, words: Option<Say>) -> Result<Self, Status> {
        let endpoint = Endpoint::from_shared(format!("http://{addr}")).expect("an address");
        let mut client = FarmClient::new(endpoint.connect().await.expect("a coordinator"));
        let challenge = client.greet(GreetRequest {}).await?.into_inner().challenge.try_into().expect("32 bytes");
        let words = match words {
            // A fake of that name proves that it is that one, unless it is told to prove something else.
            Some(Say::Register(register)) if register.proof.is_empty() => {
                let proof = identity(&register.name).prove(&challenge);
                Some(Say::Register(Register { proof, ..register }))
            }
            words => words,
        };
        let (out, outbox) = mpsc::channel(64);
        out.send(WorkerMessage { kind: words }).await.expect("room for one");
        let mut inbox = client.work(ReceiverStream::new(outbox)).await?.into_inner();
        let Some(CoordinatorMessage { kind: Some(Hear::Welcome(welcome)) }) = inbox.message().await? else {
            panic!("no welcome");
        };
        let (mut beats, session) = (client.clone(), welcome.session);
        let heart = tokio::spawn(async move {
            while beats.beat(BeatRequest { session }).await.is_ok() {
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        });
        Ok(Self { out, inbox, client, welcome, heart })
    }

    /// Registers as `name` and says that it is ready without fetching anything.
    ///
    /// # Panics
    /// When it is refused.
    pub async fn ready(addr: SocketAddr, name: &str) -> Self {
        let mut fake = Self::register(addr, registration(name)).await.expect("a welcome");
        let job = fake.hear().await;
        assert!(matches!(job, Ok(Some(Hear::Job(_)))), "no job: {job:?}");
        fake.say(Say::Ready(Ready::default())).await;
        fake
    }

    /// Says that; whether it can still be heard is seen by listening.
    pub async fn say(&self, kind: Say) {
        let _ = self.out.send(WorkerMessage { kind: Some(kind) }).await;
    }

    /// Lives on, without a sign of it.
    pub fn falls_silent(&self) {
        self.heart.abort();
    }

    /// The next words of the coordinator; `None` where it ended the stream in peace.
    ///
    /// # Errors
    /// The status by which it ended the stream.
    ///
    /// # Panics
    /// When nothing comes for a minute.
    pub async fn hear(&mut self) -> Result<Option<Hear>, Status> {
        let message = tokio::time::timeout(NEVER, self.inbox.message()).await.expect("nothing comes");
        message.map(|m| m.and_then(|m| m.kind))
    }

    /// The next lease.
    ///
    /// # Panics
    /// When something else comes.
    pub async fn lease(&mut self) -> Lease {
        match self.hear().await {
            Ok(Some(Hear::Lease(lease))) => lease,
            other => panic!("{other:?} where a lease was expected"),
        }
    }

    /// The status by which the coordinator ends the stream.
    ///
    /// # Panics
    /// When it ends in peace.
    pub async fn cut_off(&mut self) -> Status {
        loop {
            match self.hear().await {
                Err(status) => return status,
                Ok(Some(_)) => {}
                Ok(None) => panic!("it ended in peace"),
            }
        }
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        self.heart.abort();
    }
}
