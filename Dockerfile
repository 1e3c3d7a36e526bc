# Guise in a container, for files and folders:
#
#     docker build -t guise .
#     docker run --rm -v "$PWD:/work" --user "$(id -u):$(id -g)" guise deidentify interview.mp4
#
# People and settings are kept in /home/guise: add -v guise-home:/home/guise to keep them.  Faces are drawn by the
# processor.  The studio and `guise live` want a browser, a camera and a screen: install Guise on the computer itself.

# With a C++ compiler, which the slim image below lacks.
FROM python:3.12 AS build
WORKDIR /source
COPY pyproject.toml setup.py README.md LICENSE ./
COPY guise guise
COPY aam aam
COPY analogy analogy
COPY app app
COPY common common
COPY render render
COPY sample_videos sample_videos
COPY docs/guise.1 docs/guise.1
RUN python -m venv /opt/guise
RUN /opt/guise/bin/pip install --no-cache-dir --disable-pip-version-check .

FROM python:3.12-slim
COPY --from=build /opt/guise /opt/guise
ENV PATH=/opt/guise/bin:$PATH HOME=/home/guise
RUN mkdir -m 777 /home/guise
WORKDIR /work
ENTRYPOINT ["guise"]
CMD ["--help"]
