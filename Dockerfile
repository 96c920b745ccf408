# docker build -t farpoint .
# docker run --rm -v "$PWD:/work" farpoint                                  the demonstration
# docker run --rm -v "$PWD:/work" farpoint run drive.mp4 --camera camera.yaml
FROM python:3.13-slim

COPY . /farpoint
RUN pip install --no-cache-dir -c /farpoint/constraints.txt "/farpoint[video]"

# Kernels are compiled once, here, into a place that any user can read and write.
ENV NUMBA_CACHE_DIR=/var/cache/farpoint
RUN mkdir -m 777 "$NUMBA_CACHE_DIR" \
    && farpoint compile \
    && chmod -R a+rwX "$NUMBA_CACHE_DIR"

WORKDIR /work
ENTRYPOINT ["farpoint"]
CMD ["demo"]
