"""What HTTP asks of every answer: errors, security, caching, negotiation, bodies, metrics, OpenAPI, pages."""
