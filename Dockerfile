# An image that runs the tests: docker build -t usbench . && docker run --rm usbench
FROM python:3.13-slim

# make for the jobs, git and a compiler's absence as in CI; Chromium for the tests in a browser.
RUN apt-get update --quiet=2 \
    && DEBIAN_FRONTEND=noninteractive apt-get install --yes --quiet=2 --no-install-recommends \
        chromium git make procps \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /usbench
# The packages alone first: they are installed again only where their versions change.
ENV PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
COPY pyproject.toml constraints.txt README.md LICENSE usbench_command.py Makefile ./
COPY . .
RUN python3 -m venv .venv \
    && .venv/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]' \
    && touch .venv/.installed

CMD ["make", "test"]
