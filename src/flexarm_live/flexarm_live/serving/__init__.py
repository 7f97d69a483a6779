"""Server: access, requests and what is sent."""
