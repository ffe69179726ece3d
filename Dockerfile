# docker build -t brdf .
# docker run --rm -p 127.0.0.1:8000:8000 -v brdf-data:/data brdf
#
# Read-only: whoever reaches the port may look values up, nobody may store or delete. To allow that to those who know a
# key, add: -e BRDF_API_KEY=... The line above publishes the port to this machine only; leave out "127.0.0.1:" to publish
# it to the network.

# by its digest, so that a build next year has the same base: 3.12.13 on Debian 13, as the list of official images
# (docker-library/repo-info, repos/python/remote/3.12-slim.md) had it in August 2026. For a newer one take its digest
# from there, or from `docker buildx imagetools inspect python:3.12-slim`.
FROM python:3.12-slim@sha256:229a2c5bfa27522db7815ea81f9bed70af17ccb9de9fc7ad142b1877b5830d36

# numba reads the machine it runs on and compiles for it, so kernels are not compiled here: a cache made on the
# builder would be ignored on another processor. They are compiled at every start before /health/ready says yes: seconds
# the first time, and read from the volume after that.
ENV PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    PIP_NO_CACHE_DIR=1 \
    BRDF_DATA_DIR=/data/materials \
    NUMBA_CACHE_DIR=/data/cache \
    MPLCONFIGDIR=/data/cache/matplotlib

# the source is not left in the image: what runs is what was installed
COPY pyproject.toml README.md LICENSE /source/
COPY brdfcore /source/brdfcore
COPY app /source/app
RUN pip install "/source[service]" && rm -r /source

# not root; the number is fixed so that the owner of a mounted folder can be set to it
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin brdf \
    && mkdir /data && chown brdf:brdf /data
USER brdf
WORKDIR /data
VOLUME /data
EXPOSE 8000

# /health/live asks only whether the process answers. The first start also builds the starter library and compiles:
# until then a failed check does not count. A load balancer should ask /health/ready instead.
HEALTHCHECK --interval=15s --timeout=5s --start-period=120s --retries=3 \
    CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/health/live', timeout=4)"]

# 0.0.0.0 inside the container: a loopback bind could not be published. SIGTERM from `docker stop` drains
# for BRDF_DRAIN_SECONDS (10), as long as docker waits before it kills.
STOPSIGNAL SIGTERM
CMD ["brdf", "serve", "--host", "0.0.0.0", "--port", "8000"]
