//! Topics through Cyclone DDS, a library in C: the one place of this program with `unsafe`.
//!
//! What keeps it sound: readers are deleted before what they call is freed, writers keep their participant; what is called back sits behind a
//! lock and does not unwind into C; samples are read within the length that the library says, and given back; text handed over ends with a
//! zero and outlives the call.
#![allow(unsafe_code)]

use cyclors::{
    DDS_ANY_STATE, cdds_create_blob_topic, dds_create_domain, dds_create_listener, dds_create_participant,
    dds_create_qos, dds_create_reader, dds_create_writer, dds_delete, dds_delete_listener, dds_delete_qos,
    dds_durability_kind_DDS_DURABILITY_TRANSIENT_LOCAL, dds_durability_kind_DDS_DURABILITY_VOLATILE, dds_entity_t,
    dds_get_entity_sertype, dds_get_guid, dds_get_publication_matched_status, dds_guid_t,
    dds_history_kind_DDS_HISTORY_KEEP_LAST, dds_log_data_t, dds_lset_data_available_arg,
    dds_publication_matched_status_t, dds_qset_data_representation, dds_qset_durability, dds_qset_durability_service,
    dds_qset_history, dds_qset_ignorelocal, dds_qset_reliability, dds_qset_userdata, dds_qset_writer_data_lifecycle,
    dds_reliability_kind_DDS_RELIABILITY_BEST_EFFORT, dds_reliability_kind_DDS_RELIABILITY_RELIABLE, dds_sample_info_t,
    dds_set_log_sink, dds_strretcode, dds_takecdr, dds_writecdr, ddsi_serdata, ddsi_serdata_from_ser_iov,
    ddsi_serdata_kind_SDK_DATA, ddsi_serdata_size, ddsi_serdata_to_ser_ref, ddsi_serdata_to_ser_unref,
    ddsi_serdata_unref, ddsi_sertype, ddsrt_iovec_t,
};
use mapwright_live::wire::{Delivery, Hear};
use std::collections::VecDeque;
use std::ffi::{CStr, CString, c_void};
use std::io::Write;
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;
use std::sync::{Arc, Mutex, PoisonError};

/// Who writes waits so long for who is slow, nanoseconds: as ROS 2's middlewares do.
const BLOCKING_NS: i64 = 100_000_000;
/// Samples taken at once.
const AT_ONCE: usize = 16;
/// Samples of a topic with several readers that are known to have been heard.
const HEARD: usize = 64;
/// The representation that ROS 2 uses.
const XCDR1: i16 = 0;

/// What the library says went wrong.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("Cyclone DDS: {0}")]
pub(crate) struct CycloneError(String);

/// What a handle or a code says.
fn check(code: i32) -> Result<i32, CycloneError> {
    if code >= 0 {
        return Ok(code);
    }
    // SAFETY: the library returns a text of its own for any code, ended by a zero, that lives as long as it does.
    let words = unsafe { CStr::from_ptr(dds_strretcode(code)) };
    Err(CycloneError(words.to_string_lossy().into_owned()))
}

fn text(name: &str) -> Result<CString, CycloneError> {
    CString::new(name).map_err(|_| CycloneError(format!("a name with a zero in it: {name:?}")))
}

/// How an endpoint of a topic behaves; freed when dropped.
struct Qos(*mut cyclors::dds_qos_t);

impl Qos {
    fn new(delivery: Delivery) -> Self {
        let (reliability, durability, depth) = match delivery {
            Delivery::BestEffort { depth } => {
                (dds_reliability_kind_DDS_RELIABILITY_BEST_EFFORT, dds_durability_kind_DDS_DURABILITY_VOLATILE, depth)
            }
            Delivery::Reliable { depth } | Delivery::AsOffered { depth } => {
                (dds_reliability_kind_DDS_RELIABILITY_RELIABLE, dds_durability_kind_DDS_DURABILITY_VOLATILE, depth)
            }
            Delivery::Latched { depth } => (
                dds_reliability_kind_DDS_RELIABILITY_RELIABLE,
                dds_durability_kind_DDS_DURABILITY_TRANSIENT_LOCAL,
                depth,
            ),
        };
        let depth = i32::try_from(depth.max(1)).unwrap_or(i32::MAX);
        let keep_last = dds_history_kind_DDS_HISTORY_KEEP_LAST;
        // SAFETY: a fresh value of the library's, changed by its own functions while nobody else has it; `XCDR1` is copied by the call.
        unsafe {
            let qos = dds_create_qos();
            dds_qset_reliability(qos, reliability, BLOCKING_NS);
            dds_qset_durability(qos, durability);
            dds_qset_history(qos, keep_last, depth);
            if matches!(delivery, Delivery::Latched { .. }) {
                dds_qset_durability_service(qos, 0, keep_last, depth, -1, -1, -1);
            }
            dds_qset_writer_data_lifecycle(qos, false);
            dds_qset_ignorelocal(qos, cyclors::dds_ignorelocal_kind_DDS_IGNORELOCAL_PARTICIPANT);
            dds_qset_data_representation(qos, 1, &XCDR1);
            Self(qos)
        }
    }
}

impl Drop for Qos {
    fn drop(&mut self) {
        // SAFETY: made by `dds_create_qos`, and nobody keeps it.
        unsafe { dds_delete_qos(self.0) }
    }
}

/// What the library says of types: others describe theirs in a way that it cannot read, which nobody needs.
const OF_TYPES: &[u8] = b"type object";

/// Says what the library has to say on the standard error, as it does itself, but for what is of no use.
unsafe extern "C" fn say(_: *mut c_void, data: *const dds_log_data_t) {
    // SAFETY: the library calls it with data that holds until it returns, with a text of so many bytes.
    let text = unsafe {
        let data = &*data;
        if data.message.is_null() { &[][..] } else { std::slice::from_raw_parts(data.message.cast::<u8>(), data.size) }
    };
    if !text.windows(OF_TYPES.len()).any(|part| part == OF_TYPES) {
        // nothing helps where that cannot be written
        let _ = std::io::stderr().write_all(&[b"Cyclone DDS: ", text].concat());
    }
}

/// What is called with samples; its place does not change while its readers are there.
struct Listening(Mutex<Ear>);

/// Who hears, and of several readers of one topic which samples were heard: the writers' numbers, and when each wrote.
struct Ear {
    hear: Hear,
    heard: Option<VecDeque<(u64, i64)>>,
}

impl Ear {
    /// Whether a sample is heard for the first time.
    fn is_new(&mut self, writer: u64, written: i64) -> bool {
        let Some(heard) = &mut self.heard else { return true };
        if heard.contains(&(writer, written)) {
            return false;
        }
        if heard.len() >= HEARD {
            heard.pop_front();
        }
        heard.push_back((writer, written));
        true
    }
}

/// A participant's handle and its domain's, which go when nobody has them any more.
#[derive(Debug)]
struct Handles {
    participant: dds_entity_t,
    domain: dds_entity_t,
}

impl Drop for Handles {
    fn drop(&mut self) {
        // SAFETY: own handles, which nobody has any more; what they still contain is deleted with them.
        unsafe {
            dds_delete(self.participant);
            dds_delete(self.domain);
        }
    }
}

/// A participant of a domain with its readers.
pub(crate) struct Participant {
    handles: Arc<Handles>,
    /// Each reader with what it calls; in a place of its own, for the library knows where that is.
    readers: Vec<(dds_entity_t, Arc<Listening>)>,
}

impl Participant {
    /// Joins a domain with a configuration in XML.
    pub(crate) fn new(domain: u32, configuration: &str, user_data: &str) -> Result<Self, CycloneError> {
        let configuration = text(configuration)?;
        // SAFETY: a function that is there as long as the program, and needs nothing.
        unsafe { dds_set_log_sink(Some(say), ptr::null_mut()) };
        // SAFETY: the text outlives the call, which copies what it needs of it.
        let made = check(unsafe { dds_create_domain(domain, configuration.as_ptr()) })?;
        let qos = Qos::new(Delivery::Reliable { depth: 1 });
        // SAFETY: the bytes are copied by the first call, the value by the second, which looks at this part of it alone; no listener.
        let participant = check(unsafe {
            dds_qset_userdata(qos.0, user_data.as_ptr().cast::<c_void>(), user_data.len());
            dds_create_participant(domain, qos.0, ptr::null())
        });
        match participant {
            Ok(participant) => {
                Ok(Self { handles: Arc::new(Handles { participant, domain: made }), readers: Vec::new() })
            }
            Err(error) => {
                // SAFETY: a handle that was just made.
                unsafe { dds_delete(made) };
                Err(error)
            }
        }
    }

    /// The participant's sixteen bytes that are its own in the world.
    pub(crate) fn guid(&self) -> [u8; 16] {
        guid(self.handles.participant)
    }

    fn topic(&self, name: &str, kind: &str) -> Result<dds_entity_t, CycloneError> {
        let (name, kind) = (text(name)?, text(kind)?);
        // SAFETY: texts that outlive the call, which copies them; the library does not write to them though its types allow it.
        check(unsafe {
            cdds_create_blob_topic(self.handles.participant, name.as_ptr().cast_mut(), kind.as_ptr().cast_mut(), true)
        })
    }

    /// Hears a topic as long as the participant is there; the sixteen bytes of its readers come back. What is heard as it is offered has two: one
    /// that asks for what was lost, which those who keep nothing do not match, and one that does not; what both hear is heard once.
    pub(crate) fn read(
        &mut self,
        name: &str,
        kind: &str,
        delivery: Delivery,
        hear: Hear,
    ) -> Result<Vec<[u8; 16]>, CycloneError> {
        let topic = self.topic(name, kind)?;
        let deliveries = match delivery {
            Delivery::AsOffered { depth } => vec![Delivery::Reliable { depth }, Delivery::BestEffort { depth }],
            one => vec![one],
        };
        let heard = (deliveries.len() > 1).then(VecDeque::new);
        let listening = Arc::new(Listening(Mutex::new(Ear { hear, heard })));
        let mut guids = Vec::new();
        for delivery in deliveries {
            let reader = self.reader(topic, delivery, &listening)?;
            self.readers.push((reader, Arc::clone(&listening)));
            guids.push(guid(reader));
        }
        Ok(guids)
    }

    fn reader(
        &self,
        topic: dds_entity_t,
        delivery: Delivery,
        listening: &Arc<Listening>,
    ) -> Result<dds_entity_t, CycloneError> {
        let qos = Qos::new(delivery);
        let address = Arc::as_ptr(listening).cast_mut().cast::<c_void>();
        // SAFETY: `listening` stays where it is, and is kept by whoever calls this until after the reader is deleted (in `drop`), so that `address`
        // holds; `on_data` is what the library expects. The listener is copied by the call that makes the reader.
        let reader = unsafe {
            let listener = dds_create_listener(ptr::null_mut());
            dds_lset_data_available_arg(listener, Some(on_data), address, true);
            let reader = dds_create_reader(self.handles.participant, topic, qos.0, listener);
            dds_delete_listener(listener);
            reader
        };
        check(reader)
    }

    /// A writer of a topic, which keeps the participant there.
    pub(crate) fn write(&self, name: &str, kind: &str, delivery: Delivery) -> Result<Writer, CycloneError> {
        let topic = self.topic(name, kind)?;
        let qos = Qos::new(delivery);
        // SAFETY: handles of this participant; the value is copied; no listener.
        let handle = check(unsafe { dds_create_writer(self.handles.participant, topic, qos.0, ptr::null()) })?;
        Ok(Writer { handle, _handles: Arc::clone(&self.handles) })
    }
}

impl Drop for Participant {
    fn drop(&mut self) {
        for (reader, _) in &self.readers {
            // SAFETY: an own handle; the call waits until nobody is being called for it, so that what it calls can go afterwards.
            unsafe { dds_delete(*reader) };
        }
    }
}

fn guid(entity: dds_entity_t) -> [u8; 16] {
    let mut guid = dds_guid_t { v: [0; 16] };
    // SAFETY: writes sixteen bytes, or nothing where the handle is none.
    let _ = unsafe { dds_get_guid(entity, &mut guid) };
    guid.v
}

/// Tells one topic.
#[derive(Debug)]
pub(crate) struct Writer {
    handle: dds_entity_t,
    _handles: Arc<Handles>,
}

impl Writer {
    pub(crate) fn guid(&self) -> [u8; 16] {
        guid(self.handle)
    }

    /// How many readers match it.
    pub(crate) fn matched(&self) -> usize {
        let mut status = MaybeUninit::<dds_publication_matched_status_t>::zeroed();
        // SAFETY: of plain numbers, all zeros before; the library fills it or leaves it so.
        let status = unsafe {
            dds_get_publication_matched_status(self.handle, status.as_mut_ptr());
            status.assume_init()
        };
        status.current_count as usize
    }

    /// Sends a message in CDR with its head.
    pub(crate) fn write(&self, message: &[u8]) -> Result<(), CycloneError> {
        let part = ddsrt_iovec_t { iov_base: message.as_ptr().cast_mut().cast::<c_void>(), iov_len: message.len() };
        let mut sertype: *const ddsi_sertype = ptr::null();
        // SAFETY: writes one pointer, to what lives as long as the writer, which is this value's own.
        check(unsafe { dds_get_entity_sertype(self.handle, &mut sertype) })?;
        // SAFETY: one part of readable bytes, copied by the call; the sertype is the living writer's.
        let serdata =
            unsafe { ddsi_serdata_from_ser_iov(sertype, ddsi_serdata_kind_SDK_DATA, 1, &part, message.len()) };
        if serdata.is_null() {
            return Err(CycloneError(format!("no room for a message of {} bytes", message.len())));
        }
        // SAFETY: the call takes over the one count that `serdata` has.
        check(unsafe { dds_writecdr(self.handle, serdata) }).map(drop)
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // SAFETY: an own handle, of a participant that is kept.
        unsafe { dds_delete(self.handle) };
    }
}

/// Called by the library when a reader has samples.
unsafe extern "C" fn on_data(reader: dds_entity_t, address: *mut c_void) {
    // SAFETY: the address of a `Listening` that outlives its reader.
    let listening = unsafe { &*address.cast::<Listening>() };
    // Nothing unwinds into C; a hearer that panics hears the next message all the same.
    let _ = catch_unwind(AssertUnwindSafe(|| {
        let mut ear = listening.0.lock().unwrap_or_else(PoisonError::into_inner);
        while take(reader, &mut ear) == AT_ONCE {}
    }));
}

/// Hands on what a reader has; how many samples it were.
fn take(reader: dds_entity_t, ear: &mut Ear) -> usize {
    let mut samples = [ptr::null_mut::<ddsi_serdata>(); AT_ONCE];
    let mut infos = [const { MaybeUninit::<dds_sample_info_t>::uninit() }; AT_ONCE];
    // SAFETY: room for `AT_ONCE` samples and as many infos.
    let taken = unsafe {
        dds_takecdr(
            reader,
            samples.as_mut_ptr(),
            AT_ONCE as u32,
            infos.as_mut_ptr().cast::<dds_sample_info_t>(),
            DDS_ANY_STATE,
        )
    };
    let taken = usize::try_from(taken).unwrap_or(0).min(AT_ONCE);
    for (sample, info) in samples[..taken].iter().zip(&infos) {
        let sample = Sample(*sample);
        // SAFETY: the library has filled the first `taken`.
        let info = unsafe { info.assume_init_ref() };
        if info.valid_data && ear.is_new(info.publication_handle, info.source_timestamp) {
            sample.with_bytes(|bytes| (ear.hear)(bytes));
        }
    }
    taken
}

/// A sample that is given back when dropped.
struct Sample(*mut ddsi_serdata);

impl Sample {
    fn with_bytes(&self, call: impl FnOnce(&[u8])) {
        let mut part = ddsrt_iovec_t { iov_base: ptr::null_mut(), iov_len: 0 };
        // SAFETY: the sample is alive; the part that comes back is of the length asked for, which is the sample's own, and holds until it is
        // given back below. Where `call` panics the bytes stay counted, and are lost, but nothing is read after it was freed.
        unsafe {
            let size = ddsi_serdata_size(self.0) as usize;
            let counted = ddsi_serdata_to_ser_ref(self.0, 0, size, &mut part);
            if !part.iov_base.is_null() {
                call(std::slice::from_raw_parts(part.iov_base.cast::<u8>(), part.iov_len));
            }
            ddsi_serdata_to_ser_unref(counted, &part);
        }
    }
}

impl Drop for Sample {
    fn drop(&mut self) {
        // SAFETY: the one count that taking it gave.
        unsafe { ddsi_serdata_unref(self.0) }
    }
}
