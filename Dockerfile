# semsfm in a container: images below /in, results below /out.
#
#   docker build -t semsfm .
#   docker run --rm -v "$PWD/images:/in:ro" -v "$PWD/out:/out" semsfm \
#       reconstruct /in --output_path /out/project
#
# /out belongs to the user of the container (number 1000) or to who is named with --user.
FROM python:3.11-slim-bookworm

# what open3d loads from the system, as `semsfm doctor` names it
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libegl1 libgl1 libgomp1 libidn2-0 libudev1 libusb-1.0-0 libx11-6 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /src
COPY . .
# the versions that the tests run with
RUN pip install --no-cache-dir --constraint constraints.txt ".[mesh]" \
    && useradd --uid 1000 --create-home semsfm \
    && mkdir /out \
    && chown semsfm /out

# compiled code is kept where any user may write, so that --user works
ENV NUMBA_CACHE_DIR=/tmp/numba \
    MPLCONFIGDIR=/tmp/matplotlib
# by its number: a host that refuses root looks up no names
USER 1000
WORKDIR /out
ENTRYPOINT ["semsfm"]
CMD ["--help"]
