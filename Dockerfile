# An image that runs the tests: docker build -t usbench . && docker run --rm usbench
FROM python:3.13-slim

# make for the jobs; Chromium for the tests in a browser.
RUN apt-get update --quiet=2 \
    && DEBIAN_FRONTEND=noninteractive apt-get install --yes --quiet=2 --no-install-recommends \
        chromium make \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /usbench
ENV PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
# What usbench needs first: it is installed again only where these two files change.
COPY pyproject.toml constraints.txt ./
RUN python3 -m venv .venv \
    && .venv/bin/python -c "import tomllib; known = tomllib.load(open('pyproject.toml', 'rb'))['project']; \
        print(*known['dependencies'], *known['optional-dependencies']['dev'], sep='\\n')" > /tmp/needed.txt \
    && .venv/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -r /tmp/needed.txt
COPY . .
RUN .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e . \
    && touch .venv/.installed

CMD ["make", "test"]
