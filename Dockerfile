# All of flexarm on a bare Python: what `./flexarm` sets up by itself, without the compiler that it needed for it.
#   docker build -t flexarm .
#   docker run --rm -it -v "$PWD/out:/flexarm/out" flexarm ./flexarm demo
# On an installed ROS 2: Dockerfile.ros
FROM python:3.12-slim AS build

RUN apt-get update \
    && apt-get install -y --no-install-recommends build-essential \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /flexarm
COPY . .
# pip keeps no copies of what it fetched.
RUN PIP_NO_CACHE_DIR=1 ./flexarm exec true && rm -rf log

# The environment stays where it was made, since its scripts name the place.
FROM python:3.12-slim

WORKDIR /flexarm
COPY --from=build /flexarm .

# `docker stop` ends the nodes as Ctrl-C does, so that the drive is at zero before the container is killed.
STOPSIGNAL SIGINT
CMD ["./flexarm", "--help"]
