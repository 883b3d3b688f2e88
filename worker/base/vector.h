/* 3D vectors: shaders/shared/vector.h, as headers shared by C and GLSL use them, too. */
#ifndef KILN_WORKER_BASE_VECTOR_H
#define KILN_WORKER_BASE_VECTOR_H

#include "shaders/shared/vector.h"

#endif
