"""The tools of the MCP server, a file for each subject."""
