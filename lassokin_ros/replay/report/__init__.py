"""`replay --report`: an HTML page that shows the result of a replay."""
