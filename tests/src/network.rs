//! Hosts of their own on one machine, each a network namespace behind a switch in which lines fail. Linux, for root.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

/// Hosts on a switch; gone when dropped.
#[derive(Debug)]
pub struct Network {
    prefix: String,
    hosts: usize,
    delays: Vec<Child>,
}

/// What happens to a line, both ways unless it says otherwise.
#[derive(Clone, Copy, Debug)]
pub enum Fault {
    /// So many milliseconds a round trip, and so many frames of a hundred lost each way.
    Delay {
        /// Of a round trip.
        milliseconds: u32,
        /// Frames lost, of a hundred.
        loss: u32,
    },
    /// So many kilobits a second.
    Rate(u32),
    /// The host hears nothing.
    Deaf,
    /// The host is not heard.
    Mute,
    /// Nothing passes, and nobody is told.
    Cut,
}

/// Classic BPF: drops every frame.
const DROP: &str = "1,6 0 0 2";

fn call(words: &str) -> Result<Output, String> {
    let mut parts = words.split(' ');
    let program = parts.next().unwrap_or_default();
    let output = Command::new(program).args(parts).output().map_err(|e| format!("{program}: {e}"))?;
    if output.status.success() {
        Ok(output)
    } else {
        Err(format!("{words}: {}", String::from_utf8_lossy(&output.stderr).trim()))
    }
}

impl Network {
    /// A switch with so many hosts, 10.91.0.1 and on.
    ///
    /// # Errors
    /// With what is missing where that cannot be had here: the right to, or a program.
    pub fn new(hosts: usize) -> Result<Self, String> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let prefix = format!("tsr{}x{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let network = Self { prefix, hosts, delays: Vec::new() };
        let switch = network.switch();
        call(&format!("ip netns add {switch}"))?;
        call(&format!("ip -n {switch} link add br0 type bridge stp_state 0 forward_delay 0"))?;
        call(&format!("ip -n {switch} link set br0 up"))?;
        for host in 1..=hosts {
            let ns = network.host(host);
            call(&format!("ip netns add {ns}"))?;
            call(&format!("ip -n {ns} link set lo up"))?;
            call(&format!("ip -n {ns} link add eth0 type veth peer name h{host} netns {switch}"))?;
            call(&format!("ip -n {ns} addr add {}/24 dev eth0", Self::address(host)))?;
            call(&format!("ip -n {ns} link set eth0 up"))?;
            call(&format!("ip -n {switch} link set h{host} master br0 up"))?;
            call(&format!("tc -n {switch} qdisc add dev h{host} clsact"))?;
        }
        Ok(network)
    }

    fn switch(&self) -> String {
        format!("{}s", self.prefix)
    }

    fn host(&self, number: usize) -> String {
        format!("{}h{number}", self.prefix)
    }

    /// The address of a host, the first being 1.
    #[must_use]
    pub fn address(host: usize) -> String {
        format!("10.91.0.{host}")
    }

    /// `command`, to be run on a host.
    #[must_use]
    pub fn on(&self, host: usize, command: &Command) -> Command {
        let mut there = Command::new("ip");
        there.args(["netns", "exec", &self.host(host)]).arg(command.get_program()).args(command.get_args());
        for (name, value) in command.get_envs() {
            match value {
                Some(value) => there.env(name, value),
                None => there.env_remove(name),
            };
        }
        if let Some(folder) = command.get_current_dir() {
            there.current_dir(folder);
        }
        there.stdin(Stdio::null());
        there
    }

    /// Breaks a host's line, in the switch: the host itself cannot tell.
    ///
    /// # Errors
    /// With what is missing here.
    pub fn fault(&mut self, host: usize, fault: Fault) -> Result<(), String> {
        let (switch, ns) = (self.switch(), self.host(host));
        let drop = |way: &str, code: &str| {
            Command::new("tc")
                .args(["-n", &switch, "filter", "add", "dev", &format!("h{host}"), way])
                .args(["bpf", "da", "bytecode", code])
                .output()
                .map_err(|e| e.to_string())
                .and_then(|o| if o.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&o.stderr).into()) })
        };
        match fault {
            Fault::Deaf => drop("egress", DROP),
            Fault::Mute => drop("ingress", DROP),
            Fault::Cut => drop("egress", DROP).and_then(|()| drop("ingress", DROP)),
            Fault::Rate(kilobits) => {
                for (ns, device) in [(&ns, "eth0".to_owned()), (&switch, format!("h{host}"))] {
                    let rate = format!("tbf rate {kilobits}kbit burst 16k latency 200ms");
                    call(&format!("tc -n {ns} qdisc add dev {device} root {rate}"))?;
                }
                Ok(())
            }
            Fault::Delay { milliseconds, loss } => {
                let netem = format!("netem delay {}ms loss {loss}%", milliseconds / 2);
                let on_host = call(&format!("tc -n {ns} qdisc add dev eth0 root {netem}"));
                if on_host.is_ok() {
                    return call(&format!("tc -n {switch} qdisc add dev h{host} root {netem}")).map(drop_output);
                }
                // Large frames would be lost as one.
                call(&format!("ip -n {ns} link set eth0 gso_max_segs 1"))?;
                let below = u64::from(u32::MAX) * u64::from(loss) / 100;
                let lossy = format!("4,32 0 0 4294963256,53 1 0 {below},6 0 0 2,6 0 0 0");
                drop("egress", &lossy)?;
                self.delay_line(host, milliseconds / 2, &lossy)
            }
        }
    }

    /// A program between the host's cable and the switch that passes every frame on later: for kernels without netem.
    fn delay_line(&mut self, host: usize, milliseconds: u32, lossy: &str) -> Result<(), String> {
        let switch = self.switch();
        for words in [
            format!("ip -n {switch} link set h{host} nomaster"),
            format!("ip -n {switch} link add a{host} type veth peer name b{host}"),
            format!("ip -n {switch} link set a{host} up"),
            format!("ip -n {switch} link set b{host} master br0 up"),
            format!("tc -n {switch} qdisc add dev b{host} clsact"),
        ] {
            call(&words)?;
        }
        let added = Command::new("tc")
            .args(["-n", &switch, "filter", "add", "dev", &format!("b{host}"), "ingress"])
            .args(["bpf", "da", "bytecode", lossy])
            .output();
        if !added.is_ok_and(|o| o.status.success()) {
            return Err("tc takes no filter".into());
        }
        let mut line = Command::new("ip")
            .args(["netns", "exec", &switch, "python3", "-c", DELAY_LINE])
            .args([format!("h{host}"), format!("a{host}"), milliseconds.to_string()])
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| e.to_string())?;
        let mut ready = String::new();
        let read = line.stdout.take().map(|out| BufReader::new(out).read_line(&mut ready));
        self.delays.push(line);
        if read.is_some_and(|r| r.is_ok_and(|n| n > 0)) { Ok(()) } else { Err("neither netem nor python3".into()) }
    }

    /// Lets everything pass again that [`Fault::Deaf`], [`Fault::Mute`] and [`Fault::Cut`] stop.
    ///
    /// # Errors
    /// When that fails.
    pub fn heal(&self, host: usize) -> Result<(), String> {
        for way in ["ingress", "egress"] {
            call(&format!("tc -n {} filter del dev h{host} {way}", self.switch()))?;
        }
        Ok(())
    }
}

fn drop_output(_: Output) {}

impl Drop for Network {
    fn drop(&mut self) {
        for line in &mut self.delays {
            // Both fail only where it has ended already.
            let _ = line.kill();
            let _ = line.wait();
        }
        for ns in (1..=self.hosts).map(|host| self.host(host)).chain([self.switch()]) {
            let _ = call(&format!("ip netns del {ns}"));
        }
    }
}

/// Moves frames between two devices, each after a while, in their order.
const DELAY_LINE: &str = r#"
import collections, select, socket, sys, time
def port(name):
    s = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
    s.setsockopt(263, 15, 1)  # SOL_PACKET, PACKET_VNET_HDR: unfinished checksums pass whole
    s.setsockopt(263, 23, 1)  # PACKET_IGNORE_OUTGOING
    s.bind((name, 0)); s.setblocking(False)
    return s
a, b, wait = port(sys.argv[1]), port(sys.argv[2]), float(sys.argv[3]) / 1000
to, queue = {a: b, b: a}, collections.deque()
print("ready", flush=True)
while True:
    now = time.monotonic()
    timeout = max(0.0, queue[0][0] - now) if queue else 1.0
    for s in select.select([a, b], [], [], timeout)[0]:
        try:
            while True:
                queue.append((time.monotonic() + wait, to[s], s.recv(70000)))
        except BlockingIOError:
            pass
    while queue and queue[0][0] <= time.monotonic():
        _, s, frame = queue.popleft()
        try:
            s.send(frame)
        except OSError:
            pass
"#;
