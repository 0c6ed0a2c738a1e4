# list what there is
_default:
    @"{{just_executable()}}" --list --unsorted

# everything CI runs, in its order
check:
    .ci/run

# put the code into form
fmt:
    cargo fmt --all

# lints, warnings denied
lint:
    cargo clippy --workspace --all-targets -- -D warnings

# all tests
test:
    cargo test --workspace

# documentation, warnings denied
doc:
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps

# arrows between crates, effects, licences
arrows:
    cargo xtask arrows

# licences, sources and bans, by cargo-deny
deny:
    cargo deny check bans licenses sources
