"""The command `ifrdem`: one function a command, in a module a subject; `main` puts them together."""
