# This project's own entry: bash experiments/benchmark/jbridge.sh CASE OUT
exec "${PYTHON:-python}" -m jbridge diagnose "$1/model.toml" "$1"/recordings/train-*.csv \
    --holdout "$1"/recordings/holdout-*.csv --out "$2" --force --quiet
