# The server itself.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

curl -sS --fail-with-body "$url/healthz"
curl -sS --fail-with-body "$url/readyz"
curl -sS --fail-with-body "$url/metrics"

# A copy of the database in the folder that the setting backup.folder names, and which there are.
curl -sS --fail-with-body -X POST "$url/v1/backup"
curl -sS --fail-with-body "$url/v1/backup"

# One model with everything it has, as a file; the same as another model, here or on another server; and a model that goes on
# from a version of it.
curl -sS --fail-with-body "$url/v1/models/quick/archive" -o quick.headway
curl -sS --fail-with-body -X POST "$url/v1/models/elsewhere/archive" \
  -H 'Content-Type: application/vnd.sqlite3' --data-binary @quick.headway
curl -sS --fail-with-body -X POST "$url/v1/models" -H 'Content-Type: application/json' \
  -d '{"model": "fork", "method": "ewc", "settings": {"epochs": 2}, "from": {"model": "quick", "version": 1}}'

# Who changed what, and when.
curl -sS --fail-with-body "$url/v1/audit?page_size=5"

# What the interface says of itself: the contract, a page that shows it, and what to do about a problem.
curl -sS --fail-with-body "$url/openapi.json" -o openapi.json
curl -sS --fail-with-body "$url/openapi.yaml" -o openapi.yaml
curl -sS --fail-with-body "$url/docs"
curl -sS --fail-with-body "$url/docs/start.js"
curl -sS --fail-with-body "$url/problems"
curl -sS --fail-with-body "$url/problems/no_live_version"
