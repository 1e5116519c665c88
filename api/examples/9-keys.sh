# Keys: from the first on, every call takes one.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# The first is an admin's. It is shown once.
made=$(curl -sS --fail-with-body -X POST "$url/v1/keys" -H 'Content-Type: application/json' \
  -d '{"scopes": ["admin"], "name": "operations"}' | tee admin.json)
rest=${made#*'"key":"'}
key=${rest%%'"'*}

# One for a vehicle that asks for predictions of one model.
made=$(curl -sS --fail-with-body -X POST "$url/v1/keys" -H "Authorization: Bearer $key" -H 'Content-Type: application/json' \
  -d '{"scopes": ["predict"], "models": ["quick"]}')
rest=${made#*'"key_id":"'}
key_id=${rest%%'"'*}

curl -sS --fail-with-body "$url/v1/keys" -H "Authorization: Bearer $key"
curl -sS --fail-with-body "$url/v1/keys/$key_id" -H "Authorization: Bearer $key"
curl -sS --fail-with-body -X DELETE "$url/v1/keys/$key_id" -H "Authorization: Bearer $key"
