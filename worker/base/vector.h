/* Vectors of three: shaders/shared/vector.h, which the headers that C and GLSL share need too. */
#ifndef KILN_WORKER_BASE_VECTOR_H
#define KILN_WORKER_BASE_VECTOR_H

#include "shaders/shared/vector.h"

#endif
