# bash completion of cotwin, installed as share/bash-completion/completions/cotwin
source <("${1:-cotwin}" completion bash)
