# Image of an OpenEnv space: serves only OpenEnv's routes, on port 8000 and without tokens. Build and run it:
#   docker build -t sparring . && docker run -p 8000:8000 sparring
# scripts/container builds it without a daemon and without an image registry. docs/guides/operations.md has the command that
# serves the whole API, with a database on a volume at /data, which belongs to the user of the image.
FROM rust:1.95-slim-trixie AS build
WORKDIR /src
COPY . .
ENV SQLX_OFFLINE=true
RUN scripts/dist

FROM debian:trixie-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates curl \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --uid 1000 sparring \
    && install -d -o sparring -g sparring /data
COPY --from=build /src/target/dist/sparring /usr/local/bin/sparring
USER sparring
WORKDIR /home/sparring
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=3s --start-period=5s --retries=3 \
    CMD curl -fsS http://localhost:8000/readyz || exit 1
CMD ["sparring", "serve", "--openenv-public", "--bind", "0.0.0.0:8000"]
