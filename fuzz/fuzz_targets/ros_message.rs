//! Any bytes as a message of each type, straight through and by name: no panic, the same outcome both ways, what is
//! decoded is written and read back, and memory stays within a small multiple of the message.
//! `cargo +nightly fuzz run ros_message -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_geom::Stamp;
use mapwright_ros::messages::{self, Kind, LaserScan, PointCloud2, TfMessage};
use mapwright_ros::{Channel, Cloud, Decoder, Encoding, Mounting, TransformBuffer, encode};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Bytes handed out and not given back, and the most there were.
struct Counting(AtomicUsize, AtomicUsize);

#[global_allocator]
static MEMORY: Counting = Counting(AtomicUsize::new(0), AtomicUsize::new(0));

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = self.0.fetch_add(layout.size(), Relaxed) + layout.size();
        self.1.fetch_max(now, Relaxed);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        self.0.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(place, layout) }
    }
}

/// The most memory that a call has at once.
fn peak<T>(call: impl FnOnce() -> T) -> (T, usize) {
    let before = MEMORY.0.load(Relaxed);
    MEMORY.1.store(before, Relaxed);
    let result = call();
    (result, MEMORY.1.load(Relaxed).saturating_sub(before))
}

fn check<K: Kind>(encoding: Encoding, message: &[u8]) {
    let channel = Channel::new(K::TYPES[0], encoding, None).expect("a built-in type");
    let mut decoder = Decoder::<K>::new(&channel).expect("a built-in type");
    let (straight, bytes) = peak(|| decoder.decode(message));
    // a growing list is there twice for a moment, and an empty echo of 4 bytes is a slice of 24
    assert!(bytes <= 20 * message.len() + 4096, "{bytes} bytes for a message of {}", message.len());
    let (by_name, bytes) = peak(|| decoder.decode_by_name(message));
    assert!(bytes <= 100 * message.len() + 4096, "{bytes} bytes by name for a message of {}", message.len());
    assert_eq!(straight.is_ok(), by_name.is_ok());
    let (Ok(straight), Ok(by_name)) = (straight, by_name) else { return };
    let again = encode(&straight, encoding).expect("no longer than the message");
    assert!(again == encode(&by_name, encoding).expect("no longer than the message"));
    assert!(encode(&decoder.decode(&again).expect("just written"), encoding).expect("as long") == again);
}

fn check_uses(encoding: Encoding, message: &[u8]) {
    fn decoder<K: Kind>(encoding: Encoding) -> Decoder<K> {
        Decoder::new(&Channel::new(K::TYPES[0], encoding, None).expect("built in")).expect("built in")
    }
    if let Ok(message) = decoder::<PointCloud2<'static>>(encoding).decode(message)
        && let Ok(cloud) = Cloud::new(&message)
    {
        assert_eq!(cloud.points().take(1000).count(), cloud.len().min(1000));
    }
    if let Ok(scan) = decoder::<LaserScan<'static>>(encoding).decode(message) {
        let _ = scan.laser(&Mounting::IDENTITY);
    }
    if let Ok(transforms) = decoder::<TfMessage<'static>>(encoding).decode(message) {
        let mut buffer = TransformBuffer::default();
        let _ = buffer.insert_message(&transforms, false);
        let frames: Vec<_> = buffer.frames().into_iter().take(5).map(str::to_owned).collect();
        for (a, b) in frames.iter().flat_map(|a| frames.iter().map(move |b| (a, b))) {
            let known = buffer.known_times(a, b);
            let stamp = known.ok().flatten().map_or(Stamp(0), |(first, _)| first);
            let _ = buffer.lookup(a, b, stamp);
        }
    }
}

macro_rules! select {
    ($index:expr, $encoding:expr, $message:expr; $($number:literal $kind:ident),*) => {
        match $index {
            $( $number => check::<messages::$kind<'static>>($encoding, $message), )*
            _ => check_uses($encoding, $message),
        }
    };
}

fuzz_target!(|data: &[u8]| {
    let Some((selector, message)) = data.split_first() else { return };
    let encoding = if selector & 1 == 0 { Encoding::Ros1 } else { Encoding::Cdr };
    select!((selector >> 1) % 20, encoding, message; 0 LaserScan, 1 MultiEchoLaserScan, 2 PointCloud2, 3 Odometry,
        4 TfMessage, 5 Imu, 6 Image, 7 CameraInfo, 8 CompressedImage, 9 Range, 10 PoseStamped,
        11 PoseWithCovarianceStamped, 12 Path, 13 OccupancyGrid,
        14 LivoxScan, 15 OusterPacket, 16 Text);
});
