// In C++, for what C++ libraries throw reaches nothing else.
#include <cstdlib>
#include <exception>

extern "C" void kiln_on_uncaught(void (*say)(const char *what));

static void (*teller)(const char *what);

static void tell()
{
    try {
        if (const std::exception_ptr thrown = std::current_exception())
            std::rethrow_exception(thrown);
    } catch (const std::exception &exception) {
        teller(exception.what());
    } catch (...) {
    }
    teller("an exception");
    std::abort();
}

extern "C" void kiln_on_uncaught(void (*say)(const char *what))
{
    teller = say;
    std::set_terminate(tell);
}
