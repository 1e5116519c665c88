# Models: named lineages of versions, each with one method.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# The one that exists from the start, and any others.
curl -sS --fail-with-body "$url/v1/models"

# A new one. Its network is small here, so that it learns in a moment; what is not said is as in src/default.toml.
curl -sS --fail-with-body -X POST "$url/v1/models" \
  -H 'Content-Type: application/json' -H 'Idempotency-Key: create-quick' \
  -d '{"model": "quick", "method": "ewc", "settings": {"hidden": 8, "epochs": 1, "schedule": "manual", "promotion": "auto"}}'

curl -sS --fail-with-body "$url/v1/models/quick"

# Weights of the newest hundred versions are kept from now on, and those that serve or are needed.
curl -sS --fail-with-body -X PATCH "$url/v1/models/quick" \
  -H 'Content-Type: application/json' -d '{"retention": {"versions": 100}}'

# Nothing is learned between these two.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/pause"
curl -sS --fail-with-body -X POST "$url/v1/models/quick/resume"
