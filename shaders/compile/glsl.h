/* GLSL to SPIR-V by libglslang: version 1.5, as Vulkan 1.2 takes it. Any function may be called by several threads. */
#ifndef KILN_SHADERS_COMPILE_GLSL_H
#define KILN_SHADERS_COMPILE_GLSL_H

#include <cstdint>
#include <string>
#include <vector>

namespace kiln
{

/* A kernel and how it is to be compiled. */
struct kernel {
    std::string name;
    std::string stage; /* comp, rgen, rchit, rahit or rmiss */
    std::string file;
    std::vector<std::string> definitions; /* NAME or NAME=VALUE */
};

/* Begins and ends the use of libglslang by the process. */
class compiler
{
  public:
    /* Files that sources include are looked for in `root`. */
    explicit compiler(std::string root);
    ~compiler();
    compiler(const compiler &) = delete;
    compiler &operator=(const compiler &) = delete;

    /* The kernel's text after preprocessing, without empty lines: two kernels with the same text and stage become the
     * same words. Throws std::runtime_error with the compiler's messages. */
    std::string preprocess(const kernel &k);
    /* The words of SPIR-V, with names. Throws likewise. */
    std::vector<uint32_t> compile(const kernel &k);

  private:
    std::string root;
};

/* The words without what only a reader of them needs: names, sources and lines. */
std::vector<uint32_t> strip(const std::vector<uint32_t> &words);

/* Bit i: the module asks for its specialisation constant i, and does not only declare it. A literal that happens to be
 * the same number counts too. */
uint32_t constants_asked(const std::vector<uint32_t> &words);

} // namespace kiln

#endif
