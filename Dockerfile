# A small image with nothing but the static binary:
#
#     docker build -t mapwright .
#     docker run --rm -u "$(id -u):$(id -g)" -v "$PWD:/data" mapwright map drive.bag -o robot
FROM rust:1.95-slim-bookworm AS build
RUN apt-get update \
    && apt-get install -y --no-install-recommends musl-tools \
    && rm -rf /var/lib/apt/lists/*
RUN rustup target add x86_64-unknown-linux-musl
WORKDIR /build
COPY . .
ARG COMMIT=""
# /tmp: compressed ROS 2 bags of SQLite are unpacked there
RUN MAPWRIGHT_COMMIT="$COMMIT" cargo build --release --locked -p mapwright-cli --features net,view --target x86_64-unknown-linux-musl \
    && install -D -s target/x86_64-unknown-linux-musl/release/mapwright /image/usr/bin/mapwright \
    && install -D -m 644 -t /image/usr/share/doc/mapwright LICENSE-MIT LICENSE-APACHE \
    && install -d -m 1777 /image/tmp

FROM scratch
COPY --from=build /image /
WORKDIR /data
ENTRYPOINT ["/usr/bin/mapwright"]
CMD ["--help"]
