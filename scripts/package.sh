#!/usr/bin/env bash
# Packages for people who do not build: a Debian package, a static binary, a container image; into target/package.
#
#     scripts/package.sh                    # all three; what cannot be built here is named, with what is missing
#     scripts/package.sh deb                # or static, image: those that are named, and then a missing tool is an error
#     scripts/package.sh --profile dev deb  # of another profile than release, quicker to build and slower to run
#     scripts/package.sh --built deb        # of the binary that is there, without a build
#
# deb: Debian or Ubuntu with dpkg-dev; cargo-deb is installed into target/tools. static: the Rust target x86_64-unknown-linux-musl
# (`rustup target add`) and musl-gcc (Debian: musl-tools). image: docker or podman, with access to Docker Hub and crates.io.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cargo_deb_version=3.8.0
target=${CARGO_TARGET_DIR:-target}
out=$target/package
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
commit=$(git rev-parse --short=10 HEAD 2>/dev/null || true)
# Files in packages have the commit's time: the same sources, the same bytes.
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct 2>/dev/null || echo 0)
export SOURCE_DATE_EPOCH

profile=release
built=false
wanted=()
while [ $# -gt 0 ]; do
    case $1 in
        --profile) profile=${2:?"--profile: expected a profile of cargo, such as release or dev"}; shift 2 ;;
        --built) built=true; shift ;;
        deb | static | image) wanted+=("$1"); shift ;;
        *) echo "package.sh: expected deb, static, image, --built or --profile NAME, found '$1'" >&2; exit 2 ;;
    esac
done
folder=$profile
[ "$profile" != dev ] || folder=debug

# What a package has beside the binary: `pages BINARY FOLDER`.
pages() {
    rm -rf "$2"
    mkdir -p "$2/completions"
    "$1" man "$2/man" >/dev/null
    gzip -9n "$2"/man/*
    "$1" completions bash >"$2/completions/mapwright.bash"
    "$1" completions zsh >"$2/completions/_mapwright"
    "$1" completions fish >"$2/completions/mapwright.fish"
}

# ROS 2 where what builds it is there: cmake and libclang.
deb_features=net,view,zenoh
if command -v cmake >/dev/null && ls /usr/lib/llvm*/lib/libclang*.so* /usr/lib/*/libclang*.so* >/dev/null 2>&1; then
    deb_features=$deb_features,dds
fi

missing_deb() {
    command -v dpkg-shlibdeps >/dev/null || echo "no dpkg-shlibdeps: apt-get install dpkg-dev"
}

build_deb() {
    local tools=$target/tools
    if [ "$("$tools/bin/cargo-deb" --version 2>/dev/null || true)" != "cargo-deb $cargo_deb_version" ]; then
        # to be run, not debugged
        env -u CARGO_TARGET_DIR CARGO_PROFILE_DEV_DEBUG=false cargo install cargo-deb --version "$cargo_deb_version" \
            --locked --debug --force --root "$tools"
    fi
    "$built" || cargo build --profile "$profile" -p mapwright-cli --features "$deb_features"
    pages "$target/$folder/mapwright" "$target/$folder/package"
    "$tools/bin/cargo-deb" -p mapwright-cli --profile "$profile" --no-build --output "$out/"
}

musl=x86_64-unknown-linux-musl

missing_static() {
    rustc --print target-libdir --target "$musl" | xargs test -d || echo "no $musl: rustup target add $musl"
    command -v musl-gcc >/dev/null || echo "no musl-gcc: apt-get install musl-tools"
}

build_static() {
    local name=mapwright-$version-x86_64-linux-static
    "$built" || cargo build --profile "$profile" -p mapwright-cli --features net,view,zenoh --target "$musl"
    pages "$target/$musl/$folder/mapwright" "$out/$name"
    cp "$target/$musl/$folder/mapwright" LICENSE-MIT LICENSE-APACHE README.md "$out/$name"
    strip "$out/$name/mapwright"
    tar -C "$out" --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH" -c "$name" \
        | gzip -9n >"$out/$name.tar.gz"
    rm -rf "${out:?}/$name"
    echo "$out/$name.tar.gz"
}

container() {
    local tool
    for tool in docker podman; do
        if "$tool" info >/dev/null 2>&1; then
            echo "$tool"
            return
        fi
    done
}

missing_image() {
    [ -n "$(container)" ] || echo "neither docker nor podman runs here"
}

build_image() {
    local tool
    tool=$(container)
    "$tool" build --build-arg "COMMIT=$commit" -t "mapwright:$version" -t mapwright:latest .
    "$tool" save "mapwright:$version" | gzip -9n >"$out/mapwright-$version-image.tar.gz"
    echo "$out/mapwright-$version-image.tar.gz"
}

mkdir -p "$out"
named=${#wanted[@]}
[ "$named" -gt 0 ] || wanted=(deb static image)
for what in "${wanted[@]}"; do
    lacks=$("missing_$what" 2>/dev/null || true)
    if [ -z "$lacks" ]; then
        "build_$what"
    else
        echo "package $what: skipped: ${lacks//$'\n'/, }" >&2
        [ "$named" = 0 ] || exit 1
    fi
done
