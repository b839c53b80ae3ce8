//! Where a coordinator is.

use std::fmt;
use std::str::FromStr;

use tessera_proto::limits::DEFAULT_PORT;

/// A host and a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    host: String,
    port: u16,
}

/// Why an address is of no use.
#[derive(Debug, thiserror::Error)]
pub enum AddressError {
    /// Not `HOST` or `HOST:PORT`.
    #[error("{0:?} is not HOST or HOST:PORT, such as farm.example:4747, 10.0.0.5 or [::1]:4747")]
    Form(String),
    /// Nobody knows the host.
    #[error("cannot find host {host:?}: {source}")]
    Unknown {
        /// As it was given.
        host: String,
        /// What the resolver said.
        source: std::io::Error,
    },
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let wrong = || AddressError::Form(text.into());
        let (host, port) = match text.strip_prefix('[') {
            Some(rest) => {
                let (host, rest) = rest.split_once(']').ok_or_else(wrong)?;
                (host, if rest.is_empty() { None } else { Some(rest.strip_prefix(':').ok_or_else(wrong)?) })
            }
            // More than one colon: an IPv6 address without brackets.
            None if text.matches(':').count() > 1 => (text, None),
            None => text.split_once(':').map_or((text, None), |(h, p)| (h, Some(p))),
        };
        // A number alone is a port of this machine, not the address 0.0.19.151.
        let (host, port) = match port {
            None if !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit()) => ("localhost", Some(text)),
            port => (host, port),
        };
        let port = port.map_or(Ok(DEFAULT_PORT), |p| p.parse().map_err(|_| wrong()))?;
        let v6 = host.contains(':');
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
        let good = if v6 { host.parse::<std::net::Ipv6Addr>().is_ok() } else { host.chars().all(plain) };
        if host.is_empty() || port == 0 || !good {
            return Err(wrong());
        }
        Ok(Self { host: if v6 { format!("[{host}]") } else { host.into() }, port })
    }
}

impl From<std::net::SocketAddr> for Address {
    fn from(addr: std::net::SocketAddr) -> Self {
        let host = if addr.is_ipv6() { format!("[{}]", addr.ip()) } else { addr.ip().to_string() };
        Self { host, port: addr.port() }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

impl Address {
    /// The port.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.port
    }

    /// The host alone, without the brackets of an IPv6 address.
    #[must_use]
    pub fn host(&self) -> &str {
        self.host.trim_start_matches('[').trim_end_matches(']')
    }

    /// Looks the host up, so that what is wrong with a name can be said.
    ///
    /// # Errors
    /// When it does not resolve.
    pub async fn resolve(&self) -> Result<(), AddressError> {
        let unknown = |source| AddressError::Unknown { host: self.host.clone(), source };
        let mut found = tokio::net::lookup_host(self.to_string()).await.map_err(unknown)?;
        found.next().map(drop).ok_or_else(|| unknown(std::io::Error::other("it has no address")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_with_and_without_a_port() {
        let shown = |s: &str| s.parse::<Address>().unwrap().to_string();
        assert_eq!(shown("farm"), "farm:4747");
        assert_eq!(shown("localhost"), "localhost:4747");
        assert_eq!(shown("5015"), "localhost:5015");
        assert_eq!(shown("farm.example:80"), "farm.example:80");
        assert_eq!(shown("10.0.0.5:1"), "10.0.0.5:1");
        assert_eq!(shown("::1"), "[::1]:4747");
        assert_eq!(shown("[::1]"), "[::1]:4747");
        assert_eq!(shown("[fe80::1]:9"), "[fe80::1]:9");
    }

    #[test]
    fn what_is_no_address_is_said_to_be_none() {
        for bad in [
            "",
            ":1",
            "farm:",
            "farm:0",
            "farm:99999",
            "farm:x",
            "[::1",
            "[::1]x",
            "a b",
            "http://farm",
            "::zz",
            "99999",
            "0",
        ] {
            assert!(bad.parse::<Address>().is_err(), "{bad:?}");
        }
    }
}
