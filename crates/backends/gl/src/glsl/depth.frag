#version 450 core
// Depths alone.
void main() {}
