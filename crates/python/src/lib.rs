//! The compiled part of the Python package `mapwright`: the command's `map` in this process, and the mappers, one reading at a time.
//!
//! Python's lock is released while anything is mapped. Numbers are checked where they come in (`arrays`): what is of a wrong type or
//! shape is refused in words, and what a sensor may have said, such as NaN, goes to the mapper, which counts it.

mod arrays;
mod command;
mod errors;
mod kind;
mod mapper;
mod plane;
mod results;
mod settings;
mod space;
mod update;

use pyo3::prelude::*;

#[pymodule]
fn _mapwright(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("Error", module.py().get_type::<errors::Error>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<plane::Mapper2>()?;
    module.add_class::<space::Mapper3>()?;
    module.add_class::<update::Update>()?;
    module.add_class::<update::Closure>()?;
    module.add_class::<results::Grid>()?;
    module.add_function(wrap_pyfunction!(command::map_log, module)?)?;
    module.add_function(wrap_pyfunction!(command::run_command, module)?)?;
    module.add_function(wrap_pyfunction!(results::read_session, module)?)?;
    module.add_function(wrap_pyfunction!(results::read_grid, module)?)
}
