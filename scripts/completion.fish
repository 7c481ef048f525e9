# fish completion of cotwin, installed as share/fish/vendor_completions.d/cotwin.fish
cotwin completion fish | source
