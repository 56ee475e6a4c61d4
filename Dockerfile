# Without a GPU:  docker build -t desplat-ns --build-arg INDEX=ADDRESS .     (ADDRESS: docs/install.md)
# With one:       docker build -t desplat-ns --build-arg EXTRA=[cuda] .
FROM python:3.11-slim-bookworm
ARG INDEX=
ARG EXTRA=
RUN apt-get update && apt-get install -y --no-install-recommends build-essential \
    && rm -rf /var/lib/apt/lists/*
COPY . /src
RUN test -z "$INDEX" || pip install --no-cache-dir -c /src/constraints.txt -i "$INDEX" torch torchvision
RUN pip install --no-cache-dir -c /src/constraints.txt "/src$EXTRA" \
    && pip install --no-cache-dir --no-deps OpenImageIO==3.2.2.0 \
    && python -m desplat_ns.backend.compile_kernels
ENV XDG_CACHE_HOME=/cache
WORKDIR /work
