//! Settings as keyword arguments: `map_resolution_m=0.1` is `map.resolution_m`.

use mapwright::{Jobs, Settings};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyInt, PyString};

/// The dotted key and the text of each.
pub(crate) fn pairs(settings: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<(String, String)>> {
    let mut pairs = Vec::new();
    for (key, value) in settings.into_iter().flatten() {
        let key: String = key.extract()?;
        // sections have no underscore in their names
        let key = if key.contains('.') { key } else { key.replacen('_', ".", 1) };
        let text = text_of(&value, &key)?;
        pairs.push((key, text));
    }
    Ok(pairs)
}

fn text_of(value: &Bound<'_, PyAny>, key: &str) -> PyResult<String> {
    if let Ok(truth) = value.cast::<PyBool>() {
        return Ok(truth.is_true().to_string());
    }
    if value.is_instance_of::<PyString>() || value.is_instance_of::<PyInt>() {
        return Ok(value.str()?.to_cow()?.into_owned());
    }
    // numpy has whole numbers of its own
    if let Ok(whole) = value.call_method0("__index__") {
        return Ok(whole.str()?.to_cow()?.into_owned());
    }
    let number: f64 = value.extract().map_err(|_| {
        let found = value.get_type().name().map_or_else(|_| "another object".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!("setting `{key}` expects a number, a text, True or False, found {found}"))
    })?;
    Ok(number.to_string())
}

/// The settings of a mapper: the defaults and what was asked for.
pub(crate) fn of_mapper(settings: Option<&Bound<'_, PyDict>>) -> PyResult<Settings> {
    let wrong = |error: mapwright::SettingsError| PyValueError::new_err(error.to_string());
    let mut all = Settings::default();
    for (key, text) in pairs(settings)? {
        all.set(&key, &text).map_err(wrong)?;
    }
    all.validate().map_err(wrong)?;
    if all.loops.jobs != Jobs::Inline {
        return Err(PyValueError::new_err(
            "setting `loops.jobs` expects \"inline\" in Python, where nobody takes jobs that are handed out",
        ));
    }
    Ok(all)
}
