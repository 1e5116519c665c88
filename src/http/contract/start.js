// The viewer of this server's own contract. A key that is given to it stays in this tab.
window.ui = SwaggerUIBundle({
  url: "/openapi.json",
  dom_id: "#interface",
  deepLinking: true,
  displayRequestDuration: true,
  docExpansion: "list",
  filter: true,
  validatorUrl: null,
  requestSnippetsEnabled: true,
});
