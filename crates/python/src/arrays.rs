//! Numbers from Python, each checked: numpy arrays of any layout, and sequences.

use mapwright::Stamp;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Stamps are nanoseconds in 64 bits: so many seconds on either side of zero.
const LATEST_S: f64 = 9.2e9;

/// Numbers in one piece, row by row.
struct Numbers<'py> {
    values: Values<'py>,
    shape: Vec<usize>,
}

enum Values<'py> {
    Single(PyReadonlyArrayDyn<'py, f32>),
    Double(PyReadonlyArrayDyn<'py, f64>),
}

impl Numbers<'_> {
    fn to_f32(&self) -> PyResult<Vec<f32>> {
        Ok(match &self.values {
            Values::Single(values) => values.as_slice()?.to_vec(),
            Values::Double(values) => values.as_slice()?.iter().map(|&value| value as f32).collect(),
        })
    }

    fn to_f64(&self) -> PyResult<Vec<f64>> {
        Ok(match &self.values {
            Values::Single(values) => values.as_slice()?.iter().map(|&value| f64::from(value)).collect(),
            Values::Double(values) => values.as_slice()?.to_vec(),
        })
    }
}

/// What numpy makes of a value: `expected` says in words what it should be.
fn numbers<'py>(value: &Bound<'py, PyAny>, expected: &str) -> PyResult<Numbers<'py>> {
    let py = value.py();
    let numpy = py.import("numpy")?;
    let found = numpy.call_method1("asarray", (value,)).map_err(|error| not_an_array(value, expected, error))?;
    let dtype = found.getattr("dtype")?;
    let kind: String = dtype.getattr("kind")?.extract()?;
    if !["f", "i", "u"].contains(&kind.as_str()) {
        let found = type_in_words(value, &dtype)?;
        return Err(PyTypeError::new_err(format!("expected {expected}, found {found}")));
    }
    let is_double = !(found.cast::<PyArrayDyn<f32>>().is_ok() || found.cast::<PyArrayDyn<f64>>().is_ok());
    let wanted = is_double.then_some("float64");
    let whole = numpy.call_method1("require", (found, wanted, ["C_CONTIGUOUS", "ALIGNED"]))?;
    if let Ok(array) = whole.cast::<PyArrayDyn<f32>>() {
        let shape = array.shape().to_vec();
        return Ok(Numbers { values: Values::Single(array.try_readonly().map_err(in_use)?), shape });
    }
    let array = whole.cast::<PyArrayDyn<f64>>()?;
    let shape = array.shape().to_vec();
    Ok(Numbers { values: Values::Double(array.try_readonly().map_err(in_use)?), shape })
}

fn in_use(error: numpy::BorrowError) -> PyErr {
    PyValueError::new_err(format!("expected an array that nobody writes to meanwhile: {error}"))
}

/// Rows of different lengths and the like; what else went wrong, such as an interrupt, stays what it is.
fn not_an_array(value: &Bound<'_, PyAny>, expected: &str, error: PyErr) -> PyErr {
    let py = value.py();
    if error.is_instance_of::<PyValueError>(py) || error.is_instance_of::<PyTypeError>(py) {
        PyValueError::new_err(format!("expected {expected}, found what is no array: {}", error.value(py)))
    } else {
        error
    }
}

fn type_in_words(value: &Bound<'_, PyAny>, dtype: &Bound<'_, PyAny>) -> PyResult<String> {
    let name = value.get_type().name()?;
    Ok(match dtype.str()? {
        dtype if dtype.to_cow()? == "object" => name.to_string(),
        dtype => format!("{name} of {dtype}"),
    })
}

fn wrong_shape(expected: &str, shape: &[usize]) -> PyErr {
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    PyValueError::new_err(format!("expected {expected}, found an array of shape ({}{comma})", sides.join(", ")))
}

/// One row of numbers.
pub(crate) fn row(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<f32>> {
    let expected = format!("{what} as one row of numbers");
    let numbers = numbers(value, &expected)?;
    if numbers.shape.len() != 1 {
        return Err(wrong_shape(&expected, &numbers.shape));
    }
    numbers.to_f32()
}

/// Points, three numbers each.
pub(crate) fn points(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<[f32; 3]>> {
    let expected = format!("{what} as N rows of x, y and z");
    let numbers = numbers(value, &expected)?;
    // an empty list is no row at all
    if numbers.shape == [0] {
        return Ok(Vec::new());
    }
    if !matches!(numbers.shape[..], [_, 3]) {
        return Err(wrong_shape(&expected, &numbers.shape));
    }
    Ok(numbers.to_f32()?.as_chunks::<3>().0.to_vec())
}

/// So many numbers, as `expected` says in words.
pub(crate) fn exactly<const N: usize>(value: &Bound<'_, PyAny>, expected: &str) -> PyResult<[f64; N]> {
    let numbers = numbers(value, expected)?;
    let wrong = || wrong_shape(expected, &numbers.shape);
    if numbers.shape.len() != 1 {
        return Err(wrong());
    }
    numbers.to_f64()?.try_into().map_err(|_| wrong())
}

/// The same, all of them finite.
pub(crate) fn finite<const N: usize>(value: &Bound<'_, PyAny>, expected: &str) -> PyResult<[f64; N]> {
    let numbers = exactly::<N>(value, expected)?;
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(PyValueError::new_err(format!("expected {expected}, each finite, found {number}"))),
        None => Ok(numbers),
    }
}

/// A point in time.
pub(crate) fn stamp(seconds: f64) -> PyResult<Stamp> {
    if seconds.abs() <= LATEST_S {
        return Ok(Stamp::from_secs_f64(seconds));
    }
    Err(PyValueError::new_err(format!("expected a time in seconds within {LATEST_S:e} of zero, found {seconds}")))
}

/// A table of `columns` numbers a row.
pub(crate) fn table<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let rows = values.len() / columns.max(1);
    PyArray1::from_vec(py, values).reshape([rows, columns])
}
