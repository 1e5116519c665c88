# Taking back what was learned.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# The batch was learned, so what learned it is learned again without it, and then its content leaves the disk.
curl -sS --fail-with-body -X DELETE "$url/v1/models/quick/batches/b1?erase=true"

# The replay says how every regime drives before and after.
curl -sS --fail-with-body "$url/v1/models/quick/tasks/t4?wait_s=60"
curl -sS --fail-with-body "$url/v1/models/quick/batches/b1"
