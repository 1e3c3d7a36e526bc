"""What is drawn, one thing a module: each is built once from arrays, then called with a face and the memory."""
