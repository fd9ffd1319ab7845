# One image for server, scheduler and workers: docker compose chooses the command.
FROM python:3.11-slim-bookworm

# bubblewrap and libseccomp2: the sandbox of policies.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends bubblewrap libseccomp2 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/hide-seek
COPY pyproject.toml constraints.txt README.md LICENSE NOTICE ./
COPY hide_tasks hide_tasks
COPY seek_model seek_model
COPY workers workers
COPY server server
COPY web web
COPY migrations migrations
RUN pip install --no-cache-dir -c constraints.txt hatchling \
    && pip install --no-cache-dir --no-build-isolation -c constraints.txt '.[seek,dask,postgres]' \
    && python -m hide_tasks.bullet.warm \
    && useradd --create-home --uid 1000 hide \
    && install --directory --owner hide /data /cache

USER hide
WORKDIR /data
# Kernels were compiled as root beside their sources; checkpoints of a worker are kept in a volume.
ENV HIDE_SERVER_DATA=/data HIDE_WORKER_CACHE=/cache
ENTRYPOINT ["hide"]
CMD ["serve"]
