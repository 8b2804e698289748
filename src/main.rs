/// A run with nothing to do is mostly small allocations; this one makes them in half the time of the
/// system's.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    sinew::cli::main()
}
