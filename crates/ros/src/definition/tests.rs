use super::*;
use crate::schema::Base;

const ROS2: &str = "
# a comment
std_msgs/Header header   # another
int32 LIMIT=5 # with a comment
string NAME=a # that is not one
string<=8[<=3] names [\"a=b\", \"c\"]
uint8[4] bytes
byte[] data 
Inner[] inner
time at
================================================================================
MSG: pkg/Inner
float64[9] k
wstring w
char c 7
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id";

fn types(kind: &StructType) -> Vec<String> {
    kind.fields.iter().map(|field| format!("{} {}", field.ty, field.name)).collect()
}

#[test]
fn a_definition_becomes_a_tree_of_types() {
    let definition = Definition::parse("pkg/msg/Outer", DefinitionFormat::Ros2Msg, ROS2).unwrap();
    let kind = definition.schema().unwrap();
    let expected = [
        "std_msgs/Header header",
        "string[<=3] names",
        "uint8[4] bytes",
        "uint8[] data",
        "pkg/Inner[] inner",
        "builtin_interfaces/Time at",
    ];
    assert_eq!((kind.name.as_str(), types(&kind)), ("pkg/Outer", expected.map(str::to_owned).to_vec()));
    let values: Vec<_> = kind.constants.iter().map(|c| c.value.as_str()).collect();
    assert_eq!(values, ["5", "a # that is not one"]);
    let Base::Struct(inner) = &kind.fields[4].ty.base else { panic!("no message") };
    assert_eq!(types(inner), ["float64[9] k", "wstring w", "uint8 c"]);
}

#[test]
fn what_is_wrong_is_refused_with_its_line() {
    let error = |text: &str| {
        let parsed = Definition::parse("a/B", DefinitionFormat::Ros1Msg, text);
        parsed.and_then(|definition| definition.schema()).unwrap_err().to_string()
    };
    assert_eq!(error("\nint32"), "the definition of a/B, line 2: expected a type and a name, found `int32`");
    assert_eq!(error("int32[x] y"), "the definition of a/B, line 1: expected `[]`, `[N]` or `[<=N]`, found `[x]`");
    assert_eq!(error("int32 y\nC c"), "the definition of a/B, line 2: type `a/C` is defined nowhere");
    assert_eq!(error("C c\n===\nMSG: a/C\nB b"), "the definition of a/B contains itself: a/B > a/C > a/B");
    assert_eq!(
        error("int32 y;"),
        "the definition of a/B, line 1: expected a field's name, a default or a comment, found `;`"
    );
    let deep: String = (0..40).map(|i| format!("T{} t\n===\nMSG: a/T{}\n", i, i)).collect::<String>() + "int8 x";
    assert!(error(&deep).contains("nests deeper than 32 levels"));
}

#[test]
fn idl_says_the_same_as_msg() {
    let idl = r#"
IDL: pkg/msg/Outer
// generated
#include "std_msgs/msg/Header.idl"
module pkg {
  module msg {
    typedef double double__9[9];
    module Outer_Constants {
      const int32 LIMIT = 5;
      @verbatim (language="comment", text="with (brackets) \"and\" quotes")
      const string NAME = "a";
    };
    @verbatim (language="comment", text=
      "A message." "\n" "Second line; with } signs.")
    struct Outer {
      std_msgs::msg::Header header;
      @default (value=1.5)
      double__9 k;
      sequence<string<8>, 3> names;
      sequence<uint8> data; /* over
      lines */ unsigned long count;
      long long big;
      boolean yes;
      octet raw[4];
    };
  };
};
================================================================================
IDL: std_msgs/msg/Header
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
"#;
    let definition = Definition::parse("pkg/msg/Outer", DefinitionFormat::Ros2Idl, idl).unwrap();
    let kind = definition.schema().unwrap();
    let expected = [
        "std_msgs/Header header",
        "float64[9] k",
        "string[<=3] names",
        "uint8[] data",
        "uint32 count",
        "int64 big",
        "bool yes",
        "uint8[4] raw",
    ];
    assert_eq!(types(&kind), expected);
    assert_eq!(kind.constants.len(), 2);
}
