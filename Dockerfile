# An image with the command, ROS 2 without ROS included:
#
#     docker build -t mapwright .
#     docker run --rm -u "$(id -u):$(id -g)" -v "$PWD:/data" mapwright map drive.bag -o robot
#     docker run --rm --network host --ipc host -u "$(id -u):$(id -g)" -v "$PWD:/data" mapwright live -o house
FROM rust:1.95-slim-bookworm AS build
# Cyclone DDS is built by cmake, its bindings by libclang.
RUN apt-get update \
    && apt-get install -y --no-install-recommends cmake g++ libclang-dev make \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /build
COPY . .
ARG COMMIT=""
RUN MAPWRIGHT_COMMIT="$COMMIT" cargo build --release --locked -p mapwright-cli --features net,view,dds,zenoh \
    && install -D -s target/release/mapwright /image/usr/bin/mapwright \
    && install -D -m 644 -t /image/usr/share/doc/mapwright LICENSE-MIT LICENSE-APACHE

FROM debian:bookworm-slim
COPY --from=build /image /
WORKDIR /data
ENTRYPOINT ["/usr/bin/mapwright"]
CMD ["--help"]
