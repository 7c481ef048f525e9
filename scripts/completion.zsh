#compdef cotwin
# zsh completion of cotwin, installed as share/zsh/site-functions/_cotwin
source <("${words[1]}" completion zsh)
_cotwin "$@"
