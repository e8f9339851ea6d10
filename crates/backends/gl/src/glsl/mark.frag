#version 450 core
// Marks boxes in front of the depths: a bit each, in the order of the questions.
layout(early_fragment_tests) in;
layout(location = 0) flat in uint place;
layout(std430, binding = 31) coherent buffer Marks { uint marks[]; };

void main() {
    uint bit = 1u << (place % 32u);
    if ((marks[place / 32u] & bit) == 0u) {
        atomicOr(marks[place / 32u], bit);
    }
}
