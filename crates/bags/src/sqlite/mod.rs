//! ROS 2 bags as SQLite databases.
//!
//! Arrival order is by timestamp and then by row, which is the order in which `ros2 bag` plays them. Keys come in small
//! batches from the index on timestamps (where there is none, from a temporary table that SQLite keeps on disk), rows one
//! by one, so that memory does not grow with the database and a damaged page costs the rows it held. Where the index
//! itself is damaged, the rest follows in the order of rows.

mod head;
mod reader;
mod schema;

pub use reader::SqliteReader;

/// Of a database's header; behind it, on the first page, stands which tables there are.
const HEADER_BYTES: u64 = 100;
