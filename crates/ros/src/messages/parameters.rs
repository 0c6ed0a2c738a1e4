//! Parameters of nodes, and the services that read and set them.

use super::message;
use crate::slice::Slice;
use mapwright_geom::Stamp;
use std::borrow::Cow;

message! {
    /// A parameter's value: a kind, and the one field that counts.
    ParameterValue<'a> = ["rcl_interfaces/ParameterValue"];
    /// 0 none, then 1 to 9 the fields in their order.
    r#type: u8,
    /// Where the kind is 1.
    bool_value: bool,
    /// Where the kind is 2.
    integer_value: i64,
    /// Where the kind is 3.
    double_value: f64,
    /// Where the kind is 4.
    string_value: Cow<'a, str>,
    /// Where the kind is 5.
    byte_array_value: &'a [u8],
    /// Where the kind is 6.
    bool_array_value: Slice<'a, bool>,
    /// Where the kind is 7.
    integer_array_value: Slice<'a, i64>,
    /// Where the kind is 8.
    double_array_value: Slice<'a, f64>,
    /// Where the kind is 9.
    string_array_value: Vec<Cow<'a, str>>,
}

message! {
    /// A name and a value.
    Parameter<'a> = ["rcl_interfaces/Parameter"];
    /// The name; dots separate groups.
    name: Cow<'a, str>,
    /// The value.
    value: ParameterValue<'a>,
}

message! {
    /// Bounds of a floating-point parameter.
    FloatingPointRange = ["rcl_interfaces/FloatingPointRange"];
    /// The least.
    from_value: f64,
    /// The most.
    to_value: f64,
    /// Distance of values that are allowed, 0 for all.
    step: f64,
}

message! {
    /// Bounds of an integer parameter.
    IntegerRange = ["rcl_interfaces/IntegerRange"];
    /// The least.
    from_value: i64,
    /// The most.
    to_value: i64,
    /// Distance of values that are allowed, 0 for all.
    step: u64,
}

message! {
    /// What a parameter is.
    ParameterDescriptor<'a> = ["rcl_interfaces/ParameterDescriptor"];
    /// Its name.
    name: Cow<'a, str>,
    /// The kind of its values, as in [`ParameterValue`].
    r#type: u8,
    /// What it means.
    description: Cow<'a, str>,
    /// What values have to be besides.
    additional_constraints: Cow<'a, str>,
    /// Whether it cannot be set.
    read_only: bool,
    /// Whether values may be of any kind.
    dynamic_typing: bool,
    /// None or one.
    floating_point_range: Vec<FloatingPointRange>,
    /// None or one.
    integer_range: Vec<IntegerRange>,
}

message! {
    /// That parameters of a node changed.
    ParameterEvent<'a> = ["rcl_interfaces/ParameterEvent"];
    /// When.
    stamp: Stamp,
    /// The node, with its namespace.
    node: Cow<'a, str>,
    /// Those that are new.
    new_parameters: Vec<Parameter<'a>>,
    /// Those that changed.
    changed_parameters: Vec<Parameter<'a>>,
    /// Those that are gone.
    deleted_parameters: Vec<Parameter<'a>>,
}

message! {
    /// Whether a parameter was set.
    SetParametersResult<'a> = ["rcl_interfaces/SetParametersResult"];
    /// Whether it was.
    successful: bool,
    /// Why it was not.
    reason: Cow<'a, str>,
}

message! {
    /// Names of parameters.
    ListParametersResult<'a> = ["rcl_interfaces/ListParametersResult"];
    /// The names.
    names: Vec<Cow<'a, str>>,
    /// The groups that they are in.
    prefixes: Vec<Cow<'a, str>>,
}

message! {
    /// Names of parameters whose values, kinds or descriptions are wanted: the three requests are alike.
    ParameterNames<'a> = [
        "rcl_interfaces/GetParameters_Request",
        "rcl_interfaces/GetParameterTypes_Request",
        "rcl_interfaces/DescribeParameters_Request",
    ];
    /// The names.
    names: Vec<Cow<'a, str>>,
}

message! {
    /// Values, in the order of the names.
    GetParametersResponse<'a> = ["rcl_interfaces/GetParameters_Response"];
    /// The values.
    values: Vec<ParameterValue<'a>>,
}

message! {
    /// Kinds, in the order of the names.
    GetParameterTypesResponse<'a> = ["rcl_interfaces/GetParameterTypes_Response"];
    /// The kinds, as in [`ParameterValue`].
    types: &'a [u8],
}

message! {
    /// Descriptions, in the order of the names.
    DescribeParametersResponse<'a> = ["rcl_interfaces/DescribeParameters_Response"];
    /// The descriptions.
    descriptors: Vec<ParameterDescriptor<'a>>,
}

message! {
    /// Parameters to set, each for itself or all or none: the two requests are alike.
    SetParametersRequest<'a> = [
        "rcl_interfaces/SetParameters_Request",
        "rcl_interfaces/SetParametersAtomically_Request",
    ];
    /// The parameters.
    parameters: Vec<Parameter<'a>>,
}

message! {
    /// Whether each was set.
    SetParametersResponse<'a> = ["rcl_interfaces/SetParameters_Response"];
    /// In the order of the request.
    results: Vec<SetParametersResult<'a>>,
}

message! {
    /// Whether all were set.
    SetParametersAtomicallyResponse<'a> = ["rcl_interfaces/SetParametersAtomically_Response"];
    /// Of all.
    result: SetParametersResult<'a>,
}

message! {
    /// That names are wanted.
    ListParametersRequest<'a> = ["rcl_interfaces/ListParameters_Request"];
    /// Of these groups and names; of all where empty.
    prefixes: Vec<Cow<'a, str>>,
    /// With fewer dots behind the group than this; 0 for any number.
    depth: u64,
}

message! {
    /// Names of parameters.
    ListParametersResponse<'a> = ["rcl_interfaces/ListParameters_Response"];
    /// The names.
    result: ListParametersResult<'a>,
}
