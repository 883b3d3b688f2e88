/* KILN_CLONES: attribute that compiles a function once for each instruction set (AVX2 and the default), for functions
 * with loops over SIMD lanes. Floating-point contraction is off, so all versions give the same bits. */
#ifndef KILN_WORKER_BASE_CLONES_H
#define KILN_WORKER_BASE_CLONES_H

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
#    define KILN_CLONES __attribute__((target_clones("avx2", "default")))
#else
#    define KILN_CLONES
#endif

#endif
