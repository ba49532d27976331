# Never built so far.
# docker build -t lightwell .  &&  docker run --rm -v "$PWD:/work" lightwell bake cornell -o out --budget 60s
FROM python:3.12-slim
COPY . /src
RUN pip install --no-cache-dir --no-compile /src && rm -rf /src
# A user without rights; files in /work are those of the host: docker run --user "$(id -u):$(id -g)".
RUN useradd --create-home lightwell
USER lightwell
WORKDIR /work
ENTRYPOINT ["lightwell"]
CMD ["--help"]
