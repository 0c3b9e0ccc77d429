# docker build -t integ-gym .
# docker run --rm -v "$PWD/runs:/work/runs" integ-gym panel --out runs/panel
FROM python:3.11-slim
WORKDIR /work
COPY . /source
RUN /source/.ci/install "$(command -v python)" "/source[panel]" && rm -rf /source
ENTRYPOINT ["integ-gym"]
CMD ["--help"]
