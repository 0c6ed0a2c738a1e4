//! The machine's own addresses, and sockets that reach all who listen at them.

use socket2::{Domain, Protocol, SockAddr, Socket, Type};
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::time::Duration;

/// All who hear of participants, in each network (9.6.1.4.1).
pub(crate) const ALL: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// A socket that waits looks so often whether it is over.
pub(crate) const LOOK: Duration = Duration::from_millis(100);
const BUFFER_BYTES: usize = 1 << 20;

/// Addresses of this machine in its networks; those of itself alone where it is in none. None where the system does not say.
pub(crate) fn addresses() -> Vec<Ipv4Addr> {
    let found = if_addrs::get_if_addrs().unwrap_or_default();
    let of = |is_loopback: bool| {
        let v4 = found.iter().filter(move |interface| interface.is_loopback() == is_loopback && interface.is_oper_up());
        v4.filter_map(|interface| match interface.ip() {
            std::net::IpAddr::V4(address) => Some(address),
            std::net::IpAddr::V6(_) => None,
        })
    };
    let mut addresses: Vec<Ipv4Addr> = of(false).collect();
    if addresses.is_empty() {
        addresses.extend(of(true));
    }
    addresses.sort();
    addresses.dedup();
    addresses
}

fn socket() -> io::Result<Socket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    // As much as the system allows.
    let _ = socket.set_recv_buffer_size(BUFFER_BYTES);
    let _ = socket.set_send_buffer_size(BUFFER_BYTES);
    socket.set_read_timeout(Some(LOOK))?;
    Ok(socket)
}

/// A socket of our own on the first of some ports that is free; on any where none is.
pub(crate) fn own(ports: impl Iterator<Item = u16>) -> io::Result<UdpSocket> {
    let socket = socket()?;
    for port in ports.chain([0]) {
        match socket.bind(&SockAddr::from(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port))) {
            Err(error) if error.kind() == io::ErrorKind::AddrInUse && port != 0 => {}
            bound => {
                bound?;
                break;
            }
        }
    }
    socket.set_multicast_ttl_v4(1)?;
    Ok(socket.into())
}

/// A socket that hears what is sent to all, beside others that do.
pub(crate) fn shared(port: u16) -> io::Result<UdpSocket> {
    let socket = socket()?;
    socket.set_reuse_address(true)?;
    #[cfg(all(unix, not(target_os = "solaris"), not(target_os = "illumos")))]
    socket.set_reuse_port(true)?;
    socket.bind(&SockAddr::from(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port)))?;
    Ok(socket.into())
}

/// A socket that sends to all in the network of one of our addresses.
pub(crate) fn sender(address: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = socket()?;
    socket.bind(&SockAddr::from(SocketAddrV4::new(address, 0)))?;
    socket.set_multicast_if_v4(&address)?;
    socket.set_multicast_loop_v4(true)?;
    Ok(socket.into())
}
