"""Tools of the MCP server, one module per subject."""
