# One image for every service; docker-compose.yml says which module each container runs.
FROM python:3.11-slim-bookworm

# What Open3D loads from the system
RUN apt-get update \
    && apt-get install -y --no-install-recommends libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /app
COPY requirements.lock .
RUN pip install --no-cache-dir --disable-pip-version-check --root-user-action=ignore --require-hashes -r requirements.lock

COPY pyproject.toml README.md LICENSE ./
COPY shared shared
COPY services services
COPY cli cli
COPY configs configs
RUN pip install --no-cache-dir --disable-pip-version-check --root-user-action=ignore \
        --no-deps --no-build-isolation --editable . \
    && python -m compileall -q -x 'site-packages|/tests?/' /usr/local/lib/python3.11 shared services cli \
    && useradd --uid 10001 --create-home hyrecro \
    && install -d -o hyrecro /recordings \
    && install -d -o hyrecro -m 700 /credentials

USER hyrecro
RUN rerun analytics disable && python -m services.sensors.compile_kernels && python -m services.mapper.compile_kernels
ENV PYTHONUNBUFFERED=1
ENTRYPOINT ["python", "-m", "shared.runtime.guard", "/tmp/ready"]
